"""What a run has left to take away: weights, checkpoint, configuration, metrics, logs, exports."""

import hashlib
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel

from bpn_dashboard.api.context import Parts, Viewer
from bpn_dashboard.api.files import file_response
from bpn_dashboard.api.problems import ApiError, responses
from bpn_shared.runs.folder import RunFolder

router = APIRouter(tags=["artefacts"])

Kind = Literal["weights", "checkpoint", "config", "metrics", "log", "onnx"]
_PATTERNS: dict[Kind, str] = {
    "weights": "weights/*.bpnw",
    "checkpoint": "checkpoint.safetensors",
    "config": "config.json",
    "metrics": "metrics.jsonl",
    "log": "logs/*.log",
    "onnx": "exports/*.onnx",
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
    found = _artefacts(parts.runs.folder(run_id))
    return ArtefactList(items=[artefact for artefact, _ in found])


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
    for artefact, path in _artefacts(parts.runs.folder(run_id), only=artefact_id):
        return file_response(request, path, artefact.size_bytes, f'"{artefact.sha256}"')
    raise ApiError(404, "unknown-artefact", "the run has no such artefact")


def _artefacts(folder: RunFolder, only: str | None = None) -> Iterator[tuple[Artefact, Path]]:
    for kind, pattern in _PATTERNS.items():
        for path in sorted(folder.path.glob(pattern)):
            artefact_id = f"{folder.run}.{kind}.{path.stem}"
            if only in (None, artefact_id) and path.is_file() and not path.is_symlink():
                status = path.stat()
                yield (
                    Artefact(
                        id=artefact_id,
                        kind=kind,
                        name=path.name,
                        version=int(path.stem) if kind == "weights" else None,
                        size_bytes=status.st_size,
                        sha256=_sha256(path, status.st_size, status.st_mtime_ns),
                        created_at_unix_s=status.st_mtime,
                    ),
                    path,
                )


@lru_cache(maxsize=4096)
def _sha256(path: Path, size_bytes: int, _changed_ns: int) -> str:
    """Of the first `size_bytes`; a file that was changed since is hashed anew."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while size_bytes and (piece := file.read(min(size_bytes, 1 << 20))):
            digest.update(piece)
            size_bytes -= len(piece)
    return digest.hexdigest()
