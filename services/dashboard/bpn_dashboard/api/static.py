"""The web UI's files: built ones for ever, index.html for its one address."""

import html
import mimetypes
from pathlib import Path
from urllib.parse import quote

from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse

from bpn_dashboard.api.problems import ApiError

BUILT = Path(__file__).parent.parent / "static"

_ENCODINGS = (("br", ".br"), ("gzip", ".gz"))
_NOT_BUILT = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>bpn</title></head>
<body><h1>The web UI was not built</h1>
<p>The API answers under /api/v1. To build the UI, install the package with Node at hand:
<code>pip install -e services/dashboard</code>.</p></body></html>"""


def ui_routes(folder: Path = BUILT, *, prefix: str = "") -> APIRouter:
    """Routes for all paths that are not the API's.

    Args:
        prefix: the path at which browsers find the dashboard, without a slash at its end, if that is not the root.
    """
    router = APIRouter(include_in_schema=False)
    # Paths are looked up among the files that were there at the start: none is made from a request.
    files = {
        path.relative_to(folder).as_posix(): path
        for path in folder.rglob("*")
        if path.is_file() and path.suffix not in (".br", ".gz")
    }

    @router.get("/{path:path}")
    def page(request: Request, path: str) -> Response:
        if path == "api" or path.startswith("api/"):
            raise ApiError(404, "unknown-path", "there is nothing under this path")
        if path in files and path != "index.html":
            immutable = path.startswith("assets/")
            return _file(
                request,
                files[path],
                "public, max-age=31536000, immutable" if immutable else "no-cache",
            )
        if not _wants_page(request) or path.startswith("assets/"):
            raise ApiError(404, "unknown-path", "there is nothing under this path")
        if "index.html" not in files:
            return HTMLResponse(_NOT_BUILT, 503)
        if path not in ("", "index.html"):
            return RedirectResponse(_home(path), 302)
        if prefix:
            return _based(files["index.html"], prefix)
        return _file(request, files["index.html"], "no-cache")

    return router


def _home(path: str) -> str:
    """Where the page is, seen from a path that is none, whatever stands before it; it says what is not there."""
    page = quote(path.split("/", maxsplit=1)[0], safe="")
    return ("../" * path.count("/") or "./") + f"?page={page}"


def _based(index: Path, prefix: str) -> Response:
    """The page with the address to which all in it is relative: also where its own has no slash at the end."""
    base = f'<base href="{html.escape(prefix)}/" />'
    page = index.read_text().replace("<head>", f"<head>{base}", 1)
    return HTMLResponse(page, headers={"Cache-Control": "no-cache"})


def _wants_page(request: Request) -> bool:
    accepted = request.headers.get("accept", "*/*")
    return "text/html" in accepted or "*/*" in accepted


def _file(request: Request, path: Path, cache_control: str) -> Response:
    media_type = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    headers = {"Cache-Control": cache_control, "Vary": "Accept-Encoding"}
    accepted = request.headers.get("accept-encoding", "")
    for encoding, suffix in _ENCODINGS:
        packed = path.with_name(path.name + suffix)
        if encoding in accepted and packed.exists():
            headers["Content-Encoding"] = encoding
            path = packed
            break
    response = FileResponse(path, media_type=media_type, headers=headers, stat_result=path.stat())
    if request.headers.get("if-none-match") == response.headers["etag"]:
        return Response(status_code=304, headers=headers | {"ETag": response.headers["etag"]})
    return response
