"""Web pages that may use the service: its own, and no others.

A browser on this machine reaches a service that listens on loopback only, and so does every page that is open in it.
Such a page cannot hide its origin, and a name of its maker's that is pointed at 127.0.0.1 stays in the Host header.
"""

from __future__ import annotations

import ipaddress
import re
from functools import lru_cache

_AUTHORITY = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]{1,255})(?::([0-9]{1,5}))?", re.IGNORECASE)
_PORTS = {"http": 80, "https": 443}


def authority(text: str) -> tuple[str, int | None] | None:
    """Return host and port of a Host header; None where it is none."""
    found = _AUTHORITY.fullmatch(text)
    if found is None or (found[2] and int(found[2]) > 65535):
        return None
    return found[1].strip("[]").rstrip(".").lower(), int(found[2]) if found[2] else None


def is_loopback(host: str) -> bool:
    """Return whether a name or an address is this machine's own, reached from this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost" or host.endswith(".localhost")


@lru_cache(256)
def is_ours(host: str, configured: str) -> bool:
    """Return whether a Host header names a service that listens on loopback.

    Args:
        host: the header.
        configured: host that the service was told to listen on.
    """
    found = authority(host)
    return found is not None and (is_loopback(found[0]) or found[0] == configured.strip("[]").lower())


def scheme_of(own: str, proto: str | None, *, forwarded: bool) -> str:
    """Return the scheme that a browser speaks: http or https.

    Args:
        own: that the service itself speaks with whoever connects: http, https, ws or wss.
        proto: what a proxy says in X-Forwarded-Proto; None where it says nothing.
        forwarded: whether a proxy has passed the request on. What stands before the service speaks TLS, unless it says
            otherwise.
    """
    if proto is not None:
        return proto.strip().lower()
    return "https" if forwarded or own in ("https", "wss") else "http"


def is_same(origin: str, host: str, spoken: str) -> bool:
    """Return whether a page's origin is the service itself, by the request's Host and scheme."""
    scheme, _, rest = origin.partition("://")
    page, here = authority(rest), authority(host)
    default = _PORTS.get(scheme.lower())
    if page is None or here is None or default is None or scheme.lower() != spoken:
        return False
    return page[0] == here[0] and (page[1] or default) == (here[1] or default)


def is_foreign(site: str, mode: str, method: str) -> bool:
    """Return whether a browser says that another site's page has made a request; a link that is followed is none.

    Args:
        site: of the header Sec-Fetch-Site; empty where it is absent.
        mode: of Sec-Fetch-Mode.
        method: of HTTP.
    """
    return site in ("cross-site", "same-site") and not (mode == "navigate" and method == "GET")
