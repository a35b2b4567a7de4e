"""What a run has left to take away: weights, checkpoint, configuration, metrics, logs, exports."""

import hashlib
import os
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path, PurePath
from typing import BinaryIO, Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel

from bpn_dashboard.api.context import Parts, Viewer
from bpn_dashboard.api.files import file_response
from bpn_dashboard.api.problems import ApiError, responses
from bpn_shared.runs.folder import RunFolder

router = APIRouter(tags=["artefacts"])

Kind = Literal["weights", "checkpoint", "config", "metrics", "log", "onnx"]
_PLACES: dict[Kind, tuple[str, str]] = {  # folder, and pattern of names
    "weights": ("weights", r"[0-9]{1,10}\.bpnw"),
    "checkpoint": ("", r"checkpoint\.safetensors"),
    "config": ("", r"config\.json"),
    "metrics": ("", r"metrics\.jsonl"),
    "log": ("logs", r".+\.log"),
    "onnx": ("exports", r".+\.onnx"),
}
_ID_LENGTH = 36


class Artefact(BaseModel):
    """A file of a run."""

    id: str
    kind: Kind
    name: str
    version: int | None
    size_bytes: int
    sha256: str
    created_at_unix_s: float


class ArtefactList(BaseModel):
    """All of a run's, by kind and name."""

    items: list[Artefact]


@router.get("/runs/{run_id}/artefacts", operation_id="listArtefacts", responses=responses(404))
def list_artefacts(_who: Viewer, parts: Parts, run_id: str) -> ArtefactList:
    """The files of a run that can be downloaded."""
    parts.runs.get(run_id)
    items = []
    for artefact, file in _artefacts(parts.runs.folder(run_id)):
        file.close()
        items.append(artefact)
    return ArtefactList(items=items)


@router.get(
    "/artefacts/{artefact_id}",
    operation_id="downloadArtefact",
    response_class=Response,
    responses=responses(404, 416)
    | {
        200: {"content": {"application/octet-stream": {"schema": {"format": "binary"}}}},
        206: {"description": "the range asked for"},
        304: {"description": "unchanged"},
    },
)
def download_artefact(_who: Viewer, parts: Parts, request: Request, artefact_id: str) -> Response:
    """A file as attachment; its ETag is its SHA-256."""
    run_id = artefact_id[:_ID_LENGTH]
    parts.runs.get(run_id)
    # The id is compared with those of the files that are there: no path is made from it.
    for artefact, file in _artefacts(parts.runs.folder(run_id), only=artefact_id):
        etag = f'"{artefact.sha256}"'
        return file_response(request, file, artefact.name, artefact.size_bytes, etag)
    raise ApiError(404, "unknown-artefact", "the run has no such artefact")


def _artefacts(folder: RunFolder, only: str | None = None) -> Iterator[tuple[Artefact, BinaryIO]]:
    """The run's artefacts, each with its file, which the caller closes."""
    for kind, (place, pattern) in _PLACES.items():
        for name in folder.file_names(place):
            artefact_id = f"{folder.run}.{kind}.{PurePath(name).stem}"
            if only not in (None, artefact_id) or not _is_ours(name, pattern):
                continue
            inside = str(PurePath(place, name))
            try:
                file = folder.open_file(inside)
                status = os.fstat(file.fileno())
                sha256 = _sha256(folder.path, inside, status.st_size, status.st_mtime_ns)
            except OSError:  # it went away, or became something else
                continue
            artefact = Artefact(
                id=artefact_id,
                kind=kind,
                name=name,
                version=int(PurePath(name).stem) if kind == "weights" else None,
                size_bytes=status.st_size,
                sha256=sha256,
                created_at_unix_s=status.st_mtime,
            )
            yield artefact, file


def _is_ours(name: str, pattern: str) -> bool:
    return re.fullmatch(pattern, name) is not None and name.isprintable()


@lru_cache(maxsize=4096)
def _sha256(folder: Path, name: str, size_bytes: int, _changed_ns: int) -> str:
    """Of the first `size_bytes`; a file that was changed since is hashed anew."""
    digest = hashlib.sha256()
    with RunFolder(folder).open_file(name) as file:
        while size_bytes and (piece := file.read(min(size_bytes, 1 << 20))):
            digest.update(piece)
            size_bytes -= len(piece)
    return digest.hexdigest()
