"""The lines of metrics.jsonl and rewards.jsonl: one record for each iteration.

Each line bears a digest since schema 2 of a run's configuration; lines of older runs may have none, and are
believed if they look like what was written then.
"""

import logging
import threading
from pathlib import Path
from typing import Any

from bpn_shared.runs.digests import DamagedError, unseal_line
from bpn_shared.runs.tail import Tail, newest

log = logging.getLogger(__name__)

MAX_ITERATION = 2**53
"""Up to here float64 has every integer."""

_COUNTS = ("attempt", "episodes", "transitions", "updates", "weights_version")
_NUMBERS = ("length", "loss", "scale", "update_s", "collect_s", "iteration_s")


def read_line(line: bytes, *, sealed: bool) -> dict[str, Any]:
    """The record of a line, with its iteration.

    Args:
        sealed: a line without a digest is damaged.

    Raises:
        DamagedError: it is not what was written; the message says in what way.
    """
    record, has_digest = unseal_line(line)
    if sealed and not has_digest:
        raise DamagedError("it has lost its sha256")
    if not _is_count(record.get("iteration")):
        raise DamagedError(
            f"iteration = {str(record.get('iteration'))[:40]} is no number from 0 on"
        )
    if not has_digest:
        _check_looks(record)
    return record


def _check_looks(record: dict[str, Any]) -> None:
    """Of a line without a digest, what its readers rely on."""
    if "rewards_px" in record:
        return
    for name in _COUNTS:
        if not _is_count(record.get(name)):
            raise DamagedError(f"{name} = {str(record.get(name))[:40]} is no count")
    returned = "return_px" if "return_px" in record else "return"
    for name in (returned, *_NUMBERS):
        if not _is_number(record.get(name)):
            raise DamagedError(f"{name} = {str(record.get(name))[:40]} is no number")


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value < MAX_ITERATION


def _is_number(value: object) -> bool:
    return type(value) is float or (type(value) is int and abs(value) < MAX_ITERATION)


class RecordFile:
    """A file of records, read as it grows. Damaged lines are left out; each is told once.

    Args:
        root: as of `tail.read_on`.

    Attributes:
        damaged: how many lines were.
    """

    def __init__(self, path: Path, root: Path | None = None) -> None:
        self._path, self._tail = path, Tail(path, root=root)
        self._lock = threading.Lock()
        self._records: list[dict[str, Any]] = []
        self._lines = 0
        self.damaged = 0

    def read(self, *, sealed: bool) -> list[dict[str, Any]]:
        """The records so far, each iteration once and in order; the later line of an iteration counts.

        Raises:
            OSError: the file cannot be read.
        """
        with self._lock:
            while self._read_on(sealed=sealed):
                pass
            return list(self._records)

    def _read_on(self, *, sealed: bool) -> bool:
        growth = self._tail.read()
        if growth.is_new:
            self._records, self._lines, self.damaged = [], 0, 0
        added = [self._read_line(line, sealed=sealed) for line in growth.lines()]
        self._records = newest(
            [*self._records, *(record for record in added if record is not None)],
            lambda record: int(record["iteration"]),
        )
        return bool(growth.data)

    def _read_line(self, line: bytes, *, sealed: bool) -> dict[str, Any] | None:
        self._lines += 1
        try:
            return read_line(line, sealed=sealed)
        except DamagedError as error:
            self.damaged += 1
            log.warning("%s, line %d is damaged and left out: %s", self._path, self._lines, error)
            return None
