"""Files that were sent: session folders, and recordings with a notebook that become sessions.

It imports `figures` and what stands below.
"""
