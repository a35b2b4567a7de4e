"""Who could be whose partner: sites, which decide, and hosts, which are preferred."""

from collections.abc import Mapping
from typing import NamedTuple

from bpn_shared.messages.lease import Role
from bpn_shared.site import site_of


def near(label: str, other: str) -> int | None:
    """How near two workers run: 0 equal labels, 1 of one host, 2 of two hosts; None: one of them does not say."""
    if not label or not other:
        return None
    if label == other:
        return 0
    return 1 if label.partition("/")[0] == other.partition("/")[0] else 2


class Idle(NamedTuple):
    """The workers that have nothing to do.

    Attributes:
        workers: by role, their ids.
        labels: of all workers that said where they run.
    """

    workers: Mapping[Role, set[str]]
    labels: Mapping[str, str]

    def is_at(self, site: str, role: Role) -> bool:
        """Whether one of a role is at a site."""
        return any(site_of(worker) == site for worker in self.workers[role])

    def has_pairs(self) -> bool:
        """Whether at any site there are both a robot and an edge."""
        robots, edges = (set(map(site_of, self.workers[role])) for role in ("robot_sim", "edge"))
        return bool(robots & edges)

    def has_nearer(self, role: Role, worker: str, partner: str) -> bool:
        """Whether another one of a role, at the partner's site, runs nearer to the partner than a worker."""
        own = self._near(worker, partner)
        others = (
            self._near(other, partner)
            for other in self.workers[role]
            if other != worker and site_of(other) == site_of(partner)
        )
        return any(its is not None and (own is None or its < own) for its in others)

    def _near(self, worker: str, partner: str) -> int | None:
        return near(self.labels.get(worker, ""), self.labels.get(partner, ""))
