"""HTTP, whatever is asked: problems, strict requests, threads, downloads, WebSockets, log lines, metrics, OpenAPI.

It imports `storage` only; it knows no session and no model.
"""
