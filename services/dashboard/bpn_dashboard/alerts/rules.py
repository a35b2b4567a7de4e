"""When something is worth an alert. Each is told when it begins, and again only after it was over."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.hub.topology import Node

Kind = Literal["failed", "stalled", "robot_stale", "return_fell"]

NEWS_S = 600.0
"""A run that failed longer ago is no news: it was brought here, or told before."""
STALLED_AFTER_S = 60.0
STALE_AFTER_S = 10.0
"""A robot may be slow to tell; for so long it is not."""
FELL_BY = 0.5
"""Of what a run had learned: its best mean of five iterations above its first."""
_MEAN_OF = 5
_LEAST_ITERATIONS = 20
"""Before, a return wanders more than it is learned."""


@dataclass(frozen=True)
class Trouble:
    """Something that is so now.

    Attributes:
        subject: the run or worker that it is about.
        text: one sentence.
        past: it is known, and was so for long: nobody is told, also where its run is changed, as by a tag.
    """

    kind: Kind
    subject: str
    run: str | None
    text: str
    past: bool = False


def of_runs(rows: Iterable[RunRow], now_s: float) -> Iterator[Trouble]:
    """Of runs that failed, and of those that are worked on and make no progress."""
    for row in rows:
        if row.state == "failed":
            past = now_s - row.updated_at > NEWS_S
            reason = row.error.strip().splitlines()[-1:] or ["nobody said why"]
            yield Trouble("failed", row.id, row.id, f"{row.name} failed: {reason[0][:300]}", past)
        elif row.state != "queued" and row.waiting_reason and row.waiting_since is not None:
            for_s = now_s - row.waiting_since
            if for_s >= STALLED_AFTER_S:
                text = f"{row.name} makes no progress for {for_s:.0f} s: {row.waiting_reason[:300]}"
                yield Trouble("stalled", row.id, row.id, text)


def of_robots(nodes: Iterable[Node], rows: Iterable[RunRow]) -> Iterator[Trouble]:
    """Of robots of runs that shall go on, of which nothing is heard."""
    wanted = {
        row.id: row for row in rows if row.desired_state == "running" and row.state == "running"
    }
    for node in nodes:
        row = wanted.get(node.run or "")
        if row is None or not node.kind.startswith("robot") or node.state == "live":
            continue
        if node.age_s is not None and node.age_s >= STALE_AFTER_S:
            where = f"{node.id} on {node.host}"
            text = f"robot {node.slot} of {row.name} says nothing for {node.age_s:.0f} s ({where})"
            yield Trouble("robot_stale", node.id, row.id, text)


def fall(returns: npt.NDArray[np.float64]) -> float | None:
    """How much of what was learned is lost again, 1 being all of it; None: not enough of it to tell.

    Args:
        returns: of all iterations, float64[n]; NaN where there is none.
    """
    finite = returns[np.isfinite(returns)]
    if len(finite) < _LEAST_ITERATIONS:
        return None
    means = np.convolve(finite, np.full(_MEAN_OF, 1 / _MEAN_OF), mode="valid")
    first, best, now = means[0], means.max(), means[-1]
    if best <= first + max(1e-9, 0.05 * abs(first)):  # nothing was learned that could be lost
        return None
    return float((best - now) / (best - first))


def of_returns(row: RunRow, returns: npt.NDArray[np.float64]) -> Trouble | None:
    """Of a run whose return fell."""
    lost = fall(returns)
    if lost is None or lost < FELL_BY:
        return None
    best = "?" if row.return_best is None else f"{row.return_best:.4g}"
    now = "?" if row.return_mean_last_5 is None else f"{row.return_mean_last_5:.4g}"
    text = (
        f"{row.name}: the return fell to {now} (mean of the last 5), the best iteration had {best}"
    )
    return Trouble("return_fell", row.id, row.id, text)


class Standing:
    """Which troubles there are, so that each is told once.

    Args:
        told: kind and subject of those that were told in an earlier life.
    """

    def __init__(self, told: Iterable[tuple[str, str]] = ()) -> None:
        self._known = set(told)

    def news(self, troubles: Sequence[Trouble]) -> list[Trouble]:
        """Those that were not there at the last look."""
        before, self._known = self._known, {(one.kind, one.subject) for one in troubles}
        return [one for one in troubles if (one.kind, one.subject) not in before and not one.past]
