"""Which runs a rule takes away: those that nobody works on, behind the newest so many, or idle for so long."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.states import is_idle
from bpn_shared.runs.trash import DAY_S
from bpn_shared.spec.config import ConfigError

KEEP = "keep"
"""Tag of runs that no rule takes away."""


@dataclass(frozen=True)
class Rule:
    """What runs must be to be taken away; where both are given, both.

    Attributes:
        keep: how many of the newest runs stay.
        older_than_days: for how long nothing may have happened to one.
    """

    keep: int | None = None
    older_than_days: float | None = None

    def check(self) -> None:
        """Refuses a rule that would take away everything, or cannot be one.

        Raises:
            ConfigError: it says nothing, or a value is below 0.
        """
        if self.keep is None and self.older_than_days is None:
            raise ConfigError(
                "which runs? Say how many of the newest to keep, after how many days, or both"
            )
        for name, value in (("keep", self.keep), ("older than", self.older_than_days)):
            if value is not None and not 0 <= value < inf:
                raise ConfigError(f"{name} {value}: must be 0 or more, and finite")

    def outdated(self, rows: Iterable[RunRow], now_unix_s: float) -> list[RunRow]:
        """The runs to take away, oldest first.

        Args:
            rows: all runs, archived ones too. Those that are queued or being learned, and those with the tag
                "keep", stay; they count among the newest.
        """
        by_age = sorted(rows, key=lambda row: (row.created_at, row.id))
        behind = by_age if self.keep is None else by_age[: max(0, len(by_age) - self.keep)]
        return [row for row in behind if self._is_idle(row, now_unix_s)]

    def _is_idle(self, row: RunRow, now_unix_s: float) -> bool:
        if not is_idle(row.state) or KEEP in row.tags:
            return False
        days = self.older_than_days
        return days is None or now_unix_s - row.updated_at > days * DAY_S
