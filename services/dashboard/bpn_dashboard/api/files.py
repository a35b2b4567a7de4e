"""A file as it is when it is asked for, whole or in ranges, however it grows meanwhile."""

import re
from collections.abc import Iterator
from typing import BinaryIO
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import StreamingResponse

_PIECE_BYTES = 256 * 1024
_RANGE = re.compile(r"\s*bytes\s*=\s*([0-9]{0,18})\s*-\s*([0-9]{0,18})\s*", re.IGNORECASE)


def file_response(
    request: Request, file: BinaryIO, name: str, size_bytes: int, etag: str
) -> Response:
    """The file's first `size_bytes` as a download; one range of them if the request names one.

    A client that has it (If-None-Match) gets 304; a range of another version (If-Range) becomes the whole.
    The file is closed when it was sent.
    """
    headers = {
        "ETag": etag,
        "Accept-Ranges": "bytes",
        "Cache-Control": "no-cache",
        "Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, errors='replace')}",
    }
    if request.headers.get("if-none-match") == etag:
        file.close()
        return Response(status_code=304, headers=headers)
    begin, end, status = 0, size_bytes, 200
    wanted = request.headers.get("range")
    if wanted is not None and request.headers.get("if-range", etag) == etag:
        found = _range(wanted, size_bytes)
        if found == (0, 0):
            file.close()
            return Response(
                status_code=416, headers=headers | {"Content-Range": f"bytes */{size_bytes}"}
            )
        if found is not None:
            begin, end, status = *found, 206
            headers["Content-Range"] = f"bytes {begin}-{end - 1}/{size_bytes}"
    headers["Content-Length"] = str(end - begin)
    return StreamingResponse(_pieces(file, begin, end), status, headers, "application/octet-stream")


def _range(header: str, size_bytes: int) -> tuple[int, int] | None:
    """[begin, end) of a single range; (0, 0) if it is outside; None if it is to be ignored."""
    match = _RANGE.fullmatch(header)
    if match is None or match[1] == match[2] == "":
        return None
    if not match[1]:  # the last so many
        begin, end = max(0, size_bytes - int(match[2])), size_bytes
    else:
        begin, end = int(match[1]), min(size_bytes, int(match[2]) + 1 if match[2] else size_bytes)
        if match[2] and int(match[2]) < begin:
            return None
    return (begin, end) if begin < end else (0, 0)


def _pieces(file: BinaryIO, begin: int, end: int) -> Iterator[bytes]:
    with file:
        file.seek(begin)
        while begin < end and (piece := file.read(min(_PIECE_BYTES, end - begin))):
            begin += len(piece)
            yield piece
