"""How much workers have refused, by kind, as totals that never fall: workers come and go, and begin at 0."""

from collections import Counter
from collections.abc import Mapping

from bpn_shared.messages.telemetry import Telemetry

_YOUNG_S = 10.0
"""All that a service has refused counts at its first report if it is so young; else it was refused before anybody
counted here."""


def refusals(counters: Mapping[str, int], reasons: Mapping[str, str]) -> dict[str, int]:
    """By counter, how much was refused: those counters that have a reason."""
    return {name: counters[name] for name in reasons if name in counters}


class RefusalTotals:
    """Not thread-safe."""

    def __init__(self) -> None:
        self._totals: Counter[str] = Counter()

    def take(self, before: Telemetry | None, now: Telemetry) -> None:
        """A report came, after another one of the same service or as its first."""
        if before is None and now.uptime_s > _YOUNG_S:
            return
        known = {} if before is None else before.counters
        self._totals[now.kind] += sum(
            max(0, count - known.get(name, 0))
            for name, count in refusals(now.counters, now.refusals).items()
        )

    def by_kind(self) -> dict[str, int]:
        """Of every kind of service that was heard of."""
        return dict(self._totals)
