"""The files of the web page: read once, compressed once, and served with a hash of their content in the address.

The page is written as small modules that import each other by name, and those of the viewer that draw layers. They are
served as one script, each module after those it imports, without the words `import` and `export` and without
documentation, so that the page is small and needs few requests. Their names at the top level are therefore unique, and
they import and export in two simple forms only.
"""

from __future__ import annotations

import gzip
import re
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from printer_slicer.errors import PrinterSlicerError
from printer_slicer.input_files import GCODE_SUFFIXES, MODEL_SUFFIXES
from printer_slicer.javascript_modules import join_modules
from printer_slicer.preview.viewer_files import read_viewer_file
from printer_slicer.print_queue.printers import PrinterEntry
from printer_slicer.server.guard import make_page_policy
from printer_slicer.server.problems import ProblemError
from printer_slicer.server.services import Services
from printer_slicer.values import Struct

__all__ = ["ASSET_ROUTES", "Asset", "load_assets"]

_FIRST_MODULE: Final = "main.js"
_VIEWER_MODULES: Final = frozenset({"flat_window.js", "layer_view.js", "preview.js"})
_COMMENT: Final = re.compile(r"^[ \t]*/\*\*.*?\*/\n", re.MULTILINE | re.DOTALL)
_FOREVER: Final = "public, max-age=31536000, immutable"


class Asset(Struct, frozen=True):
    """A file of the page.

    Attributes:
        content: its bytes.
        compressed: the same, compressed with gzip.
        kind: media type.
        caching: value of the header `cache-control`.
        etag: quoted hash of the content.
    """

    content: bytes
    compressed: bytes
    kind: str
    caching: str
    etag: str


@cache
def load_assets() -> dict[str, Asset]:
    """Return the files of the page by address: `/`, the script and the style."""
    script, style = (
        _COMMENT.sub("", join_modules(_read_module, _FIRST_MODULE)).encode(),
        _read_page_file("page.css").encode(),
    )
    addresses = {"script": f"/page/{_hash(script)}.js", "style": f"/page/{_hash(style)}.css"}
    texts = addresses | {"models": ",".join(MODEL_SUFFIXES), "gcode": ",".join(GCODE_SUFFIXES)}
    page = re.sub(r"\{\{(\w+)\}\}", lambda found: texts[found[1]], _read_page_file("page.html"))
    return {
        "/": _make_asset(page.encode(), "text/html; charset=utf-8", "no-cache"),
        addresses["script"]: _make_asset(script, "text/javascript; charset=utf-8", _FOREVER),
        addresses["style"]: _make_asset(style, "text/css; charset=utf-8", _FOREVER),
    }


def _make_asset(content: bytes, kind: str, caching: str) -> Asset:
    """Return a file of the page with what is derived from its content."""
    return Asset(content, gzip.compress(content, 9, mtime=0), kind, caching, f'"{_hash(content)}"')


def _hash(content: bytes) -> str:
    """Return the first 80 bits of the SHA-256, hexadecimal."""
    return sha256(content).hexdigest()[:20]


def _read_page_file(name: str) -> str:
    """Return the text of a file in `page/`."""
    return files("printer_slicer.server").joinpath("page", name).read_text("utf-8")


def _read_module(name: str) -> str:
    """Return the text of a module of the page or of the viewer."""
    return read_viewer_file(name) if name in _VIEWER_MODULES else _read_page_file(name)


async def _serve_asset(request: Request) -> Response:
    """Answer with a file of the page."""
    asset = load_assets().get(request.url.path)
    if asset is None:
        raise ProblemError(404, "the page has no such file", "Load the page again")
    headers = {"etag": asset.etag, "cache-control": asset.caching, "vary": "accept-encoding"}
    if request.url.path == "/":
        headers["content-security-policy"] = await run_in_threadpool(_make_policy, request)
    if asset.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["content-encoding"] = "gzip"
        return Response(asset.compressed, headers=headers, media_type=asset.kind)
    return Response(asset.content, headers=headers, media_type=asset.kind)


def _make_policy(request: Request) -> str:
    """Return the content security policy of the page: its pictures may come from the webcams of the printers."""
    services: Services = request.app.state.services
    entries: tuple[PrinterEntry, ...] = ()
    with suppress(PrinterSlicerError):  # printers.toml is invalid at the moment
        entries = services.queue.list_printers()
    return make_page_policy(one.webcam for one in entries if one.webcam)


ASSET_ROUTES: Final = (Route("/", _serve_asset), Route("/page/{name}", _serve_asset))
"""Routes of the page; they need no session."""
