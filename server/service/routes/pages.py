"""The pages: files of `server/pages` and Plotly's script from its installed wheel, and nothing else."""

from __future__ import annotations

import gzip
import hashlib
import re
from functools import cache
from importlib.resources import files
from typing import Annotated

from fastapi import APIRouter, Path, Request
from starlette.responses import RedirectResponse, Response

from server.service.schemas.common import Matched
from server.service.web.problems import not_found

router = APIRouter(include_in_schema=False)

TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
PLOTLY = "plotly.min.js"
START = "index.html"
STYLES = re.compile(r'<link rel="stylesheet" href="/pages/([a-z_]+\.css)">')
# Plotly and the pages write styles into the document; scripts come from this very address alone.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; font-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)

Name = Annotated[str, Path(max_length=100)]


@router.get("/")
def start(request: Request, matched: Matched = None) -> Response:
    """Return the page that everything happens on."""
    return _answer(START, request, matched)


@router.get("/favicon.ico")
def icon() -> Response:
    """Send browsers that ask for it by habit to the picture."""
    return RedirectResponse("/pages/icon.svg", 308)


@router.get("/pages/{name:path}")
def page(name: Name, request: Request, matched: Matched = None) -> Response:
    """Return a script, a style or a picture by its name in the list of those that there are."""
    return _answer(name, request, matched)


def _answer(name: str, request: Request, matched: str | None) -> Response:
    if name not in names():
        raise not_found("page", name, "/")
    plain, packed, tag = content(name)
    headers = {"ETag": f'"{tag}"', "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    headers |= {"Content-Security-Policy": POLICY}
    if matched is not None and tag in matched:
        return Response(status_code=304, headers=headers)
    kind = TYPES[name[name.rindex(".") :]]
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(packed, headers=headers | {"Content-Encoding": "gzip"}, media_type=kind)
    return Response(plain, headers=headers, media_type=kind)


@cache
def names() -> frozenset[str]:
    """Return names of all files of the pages, and Plotly's."""
    root = files("server.pages")
    found = [f.name for f in root.iterdir() if f.is_file()]
    found += [f"views/{f.name}" for f in (root / "views").iterdir() if f.is_file()]
    return frozenset([n for n in found if n[n.rfind(".") :] in TYPES] + [PLOTLY])


@cache
def content(name: str) -> tuple[bytes, bytes, str]:
    """Return bytes of a file as they are, packed, and a tag that changes with them."""
    place = files("plotly") / "package_data" / PLOTLY if name == PLOTLY else files("server.pages").joinpath(name)
    plain = place.read_bytes()
    if name == START:
        plain = _with_styles(plain.decode()).encode()
    return plain, gzip.compress(plain, 6), hashlib.sha256(plain).hexdigest()[:24]


def _with_styles(page: str) -> str:
    """Put the styles into the page: a browser shows nothing before it has them, and would have to ask again."""
    return STYLES.sub(lambda link: f"<style>\n{content(link[1])[0].decode()}</style>", page)
