"""How far a run has come: read from its metrics line by line, as they are written."""

import json
from collections import deque
from typing import Any

from bpn_shared.runs.folder import RunFolder
from bpn_shared.tasks import RETURN, RETURN_PX

_MEAN_OF = 5


class Progress:
    """The summary columns of one run's row. Each `read` takes in what was written since the last one."""

    def __init__(self, folder: RunFolder) -> None:
        self._path = folder.path / "metrics.jsonl"
        self._begin()

    def _begin(self) -> None:
        self._offset_bytes = 0
        self._last: dict[str, Any] | None = None
        self._returns: deque[float] = deque(maxlen=_MEAN_OF)
        self._best: float | None = None

    def read(self) -> dict[str, Any]:
        """Iterations done and what they came to, by column of `RunRow`."""
        for line in self._new_lines():
            try:
                self._take(json.loads(line))
            except (ValueError, KeyError, TypeError):  # cut by a crash; the iteration comes again
                continue
        last = self._last
        if last is None:
            return {"iteration": 0}
        return {
            "iteration": last["iteration"] + 1,
            "weights_version": last["weights_version"],
            "return_last": self._returns[-1],
            "return_best": self._best,
            "return_mean_last_5": sum(self._returns) / len(self._returns),
            "length_last": last["length"],
        }

    def _new_lines(self) -> list[bytes]:
        try:
            with self._path.open("rb") as file:
                if file.seek(0, 2) < self._offset_bytes:  # another file in its place
                    self._begin()
                file.seek(self._offset_bytes)
                data = file.read()
        except FileNotFoundError:
            return []
        whole = data[: data.rfind(b"\n") + 1]
        self._offset_bytes += len(whole)
        return whole.splitlines()

    def _take(self, record: dict[str, Any]) -> None:
        mean_return = float(record[RETURN_PX] if RETURN_PX in record else record[RETURN])
        if self._last is not None and record["iteration"] <= self._last["iteration"]:
            self._returns.pop()  # after a crash an iteration may stand twice
        self._last = {key: record[key] for key in ("iteration", "weights_version", "length")}
        self._returns.append(mean_return)
        self._best = mean_return if self._best is None else max(self._best, mean_return)
