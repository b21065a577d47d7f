"""Sessions held against models: revisions, effects that users gave, comparisons, load cases computed by themselves.

It imports `sessions` and what stands below; it neither routes nor draws.
"""
