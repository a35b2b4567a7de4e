"""A file as it is when it is asked for, whole or in ranges, however it grows meanwhile."""

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from fastapi import Request, Response
from fastapi.responses import StreamingResponse

_PIECE_BYTES = 256 * 1024


def file_response(request: Request, path: Path, size_bytes: int, etag: str) -> Response:
    """The file's first `size_bytes` as a download; one range of them if the request names one.

    A client that has it (If-None-Match) gets 304; a range of another version (If-Range) becomes the whole.
    """
    headers = {
        "ETag": etag,
        "Accept-Ranges": "bytes",
        "Cache-Control": "no-cache",
        "Content-Disposition": f'attachment; filename="{path.name}"',
    }
    if request.headers.get("if-none-match") == etag:
        return Response(status_code=304, headers=headers)
    begin, end, status = 0, size_bytes, 200
    wanted = request.headers.get("range")
    if wanted is not None and request.headers.get("if-range", etag) == etag:
        found = _range(wanted, size_bytes)
        if found == (0, 0):
            return Response(
                status_code=416, headers=headers | {"Content-Range": f"bytes */{size_bytes}"}
            )
        if found is not None:
            begin, end, status = *found, 206
            headers["Content-Range"] = f"bytes {begin}-{end - 1}/{size_bytes}"
    headers["Content-Length"] = str(end - begin)
    return StreamingResponse(
        _pieces(path.open("rb"), begin, end), status, headers, "application/octet-stream"
    )


def _range(header: str, size_bytes: int) -> tuple[int, int] | None:
    """[begin, end) of a single range; (0, 0) if it is outside; None if it is to be ignored."""
    unit, _, ranges = header.partition("=")
    first, dash, last = (part.strip() for part in ranges.partition("-"))
    if unit.strip().lower() != "bytes" or not dash or not (first + last).isdecimal():
        return None
    if not first:  # the last so many
        begin, end = max(0, size_bytes - int(last)), size_bytes
    else:
        begin, end = int(first), min(size_bytes, int(last) + 1 if last else size_bytes)
        if last and int(last) < begin:
            return None
    return (begin, end) if begin < end else (0, 0)


def _pieces(file: BinaryIO, begin: int, end: int) -> Iterator[bytes]:
    with file:
        file.seek(begin)
        while begin < end and (piece := file.read(min(_PIECE_BYTES, end - begin))):
            begin += len(piece)
            yield piece
