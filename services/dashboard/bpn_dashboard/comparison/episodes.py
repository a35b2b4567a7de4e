"""Returns of single episodes, from the newest lines of run folders: means hide that some episodes fail."""

import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import orjson

from bpn_shared.runs.digests import DamagedError, check_line
from bpn_shared.runs.opening import open_file
from bpn_shared.runs.statistics import Floats

BINS = 30
_MOST_BYTES = 512 * 1024
_NAMES = ("returns_px", "returns")


def newest_returns(runs_dir: Path, run_id: str, iterations: int) -> Floats:
    """The finite returns of all episodes of a run's newest iterations, float64[n]; as far as they are recorded."""
    try:
        with open_file(runs_dir, f"{run_id}/metrics.jsonl") as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(max(0, size - _MOST_BYTES))
            lines = file.read(_MOST_BYTES).split(b"\n")
    except OSError:
        return np.empty(0)
    if size > _MOST_BYTES:
        lines = lines[1:]  # cut
    by_iteration: dict[int, list[float]] = {}
    for line in reversed(lines):
        returns = _returns(line)
        if returns is not None and returns[0] not in by_iteration:  # of two the later counts
            by_iteration[returns[0]] = returns[1]
        if len(by_iteration) == iterations:
            break
    return np.array([one for returns in by_iteration.values() for one in returns], np.float64)


def _returns(line: bytes) -> tuple[int, list[float]] | None:
    try:
        check_line(line)
        record = orjson.loads(line)
    except (DamagedError, orjson.JSONDecodeError):
        return None
    if not isinstance(record, dict) or type(record.get("iteration")) is not int:
        return None
    values = next((record[name] for name in _NAMES if isinstance(record.get(name), list)), None)
    if values is None:
        return None
    return record["iteration"], [
        float(v) for v in values if isinstance(v, (int, float)) and math.isfinite(v)
    ]


def edges_of(groups: Sequence[Floats]) -> Floats:
    """Of bins over the range of all values, float64[BINS + 1]; none if there are no values."""
    known = [values for values in groups if len(values)]
    if not known:
        return np.empty(0)
    low, high = min(v.min() for v in known), max(v.max() for v in known)
    return np.linspace(low, high if high > low else low + 1, BINS + 1)


def shares(by_seed: Sequence[Floats], edges: Floats) -> Floats:
    """The share of episodes in each bin, each seed with equal weight however many episodes it played."""
    known = [values for values in by_seed if len(values)]
    if not known:
        return np.zeros(max(0, len(edges) - 1))
    counts = [np.histogram(values, edges)[0] / len(values) for values in known]
    mean: Floats = np.mean(counts, axis=0)
    return mean
