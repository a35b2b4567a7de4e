"""What stands below a figure's title: which runs its numbers are of, and whether they mean anything."""

from bpn.plotting import OVER_SEEDS
from bpn.reproduce.definition import Document

QUICK = "QUICK VERSION: its numbers mean nothing"


def caption(document: Document, how: str) -> str:
    """How many seeds and iterations, and `how` they are shown; of a quick version, that it is one."""
    runs = document["runs"]
    parts = [QUICK] if document["quick"] else []
    if runs:
        seeds = len({run["seed"] for run in runs})
        lengths = sorted({len(run["lengths"]) for run in runs})
        iterations = " to ".join(map(str, dict.fromkeys((lengths[0], lengths[-1]))))
        parts.append(f"{seeds} seed{'s' if seeds > 1 else ''}, {iterations} iterations")
        if seeds == 1 and how == OVER_SEEDS:
            return "; ".join(parts)
    return "; ".join([*parts, how])
