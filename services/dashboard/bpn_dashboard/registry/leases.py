"""Who works where: a book of leases without a network.

A place is one role in one run: one of its learners, or the robot or edge of one of its slots. A lease is a
worker's token at a place, or a grant so young that its token may still come. So whoever reads all tokens
knows all leases, and a registry that was restarted goes on where the last one stopped.

The robot and the edge of a slot are of one site, always: frames do not leave it. Of one host or one core they are
if that can be had.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from uuid import UUID

from bpn_dashboard.registry.pairing import Idle, near
from bpn_shared.messages.lease import Role
from bpn_shared.site import site_of

GRANT_S = 5.0
"""How long a granted place is kept for a worker whose token has not come."""
IDLE_S = 5.0
"""How long after its last question a worker without a lease counts as idle: idle ones ask often."""
PATIENCE_S = 10.0
"""How long a robot without its edge, or one without a learner, is left where it is."""

_PARTNER: dict[Role, Role] = {"robot_sim": "edge", "edge": "robot_sim"}


class Place(NamedTuple):
    """A role in a run; a learner's slot is its rank among the learners that share the run's updates."""

    run: UUID
    role: Role
    slot: int

    @property
    def learner(self) -> "Place":
        """The place of this run's learner of rank 0, to whom the run's folder belongs."""
        return Place(self.run, "learner", 0)

    @property
    def partner(self) -> "Place":
        """A robot's edge, an edge's robot."""
        return Place(self.run, _PARTNER[self.role], self.slot)


class Demand(NamedTuple):
    """A run that wants workers: learners, and a robot with its edge for every slot."""

    run: UUID
    slots: int
    learners: int = 1

    def places(self, role: Role) -> list[Place]:
        """The places of a role that it wants filled."""
        count = self.learners if role == "learner" else self.slots
        return [Place(self.run, role, slot) for slot in range(count)]


@dataclass
class Lease:
    """A worker at a place, since when, and whether its token was seen there."""

    worker: str
    since_s: float
    confirmed: bool


class LeaseBook:
    """The leases of all runs. Times are seconds of any clock that does not jump; not thread-safe."""

    def __init__(self) -> None:
        self._demands: dict[UUID, Demand] = {}
        self._ranks: dict[UUID, int] = {}  # in the queue
        self._leases: dict[Place, Lease] = {}
        self._surplus: dict[Place, list[str]] = {}  # whose token came to a place that was taken
        self._left_s: dict[Place, float] = {}  # when a place was last left
        self._labels: dict[str, str] = {}
        self._asked: dict[
            str, tuple[Role, float]
        ] = {}  # by worker: its role, and when it last asked
        self._quiet_until_s = float("-inf")

    def demand(self, runs: Sequence[Demand]) -> None:
        """Sets which runs want workers, those to serve first first."""
        self._demands = {run.run: run for run in runs}
        self._ranks = {run.run: rank for rank, run in enumerate(runs)}
        known = self._demands.keys() | self.runs()
        self._left_s = {place: t for place, t in self._left_s.items() if place.run in known}

    def quiet(self, until_s: float) -> None:
        """Grants nothing before then: tokens that stand may not all have been seen yet."""
        self._quiet_until_s = until_s

    # Tokens

    def appeared(self, place: Place, worker: str, now_s: float) -> None:
        """A worker's token is at a place."""
        lease = self._leases.get(place)
        if lease is not None and lease.confirmed and lease.worker != worker:
            if worker not in self._surplus.setdefault(place, []):
                self._surplus[place].append(worker)
        else:  # in place of a grant to another, whose token would be the second one
            self._leases[place] = Lease(worker, now_s, confirmed=True)

    def vanished(self, place: Place, worker: str, now_s: float) -> None:
        """A worker's token is gone from a place."""
        if worker in self._surplus.get(place, ()):
            self._surplus[place].remove(worker)
            if not self._surplus[place]:
                del self._surplus[place]
        elif self.holder(place) == worker:
            self._leave(place, now_s)

    def gone(self, worker: str) -> None:
        """A worker has died, or will not ask again."""
        self._labels.pop(worker, None)
        self._asked.pop(worker, None)

    def _leave(self, place: Place, now_s: float) -> None:
        del self._leases[place]
        self._left_s[place] = now_s
        if surplus := self._surplus.pop(place, None):
            self._leases[place] = Lease(surplus[0], now_s, confirmed=True)
            if surplus[1:]:
                self._surplus[place] = surplus[1:]

    # Questions

    def holder(self, place: Place) -> str | None:
        """Who has a lease there."""
        lease = self._leases.get(place)
        return None if lease is None else lease.worker

    def is_confirmed(self, place: Place) -> bool:
        """Whether someone's token is there."""
        lease = self._leases.get(place)
        return lease is not None and lease.confirmed

    def held_s(self, place: Place, now_s: float) -> float:
        """For how long the place's holder has had it; 0 if there is none."""
        lease = self._leases.get(place)
        return 0.0 if lease is None else now_s - lease.since_s

    def idle(self, role: Role, now_s: float) -> set[str]:
        """The workers of a role that ask for work and have none."""
        at_work = {lease.worker for lease in self._leases.values()}
        asking = {
            worker
            for worker, (its_role, at_s) in self._asked.items()
            if its_role == role and now_s - at_s <= IDLE_S
        }
        return asking - at_work

    def learners(self) -> int:
        """How many learners there are, at work or idle."""
        at_work = {lease.worker for p, lease in self._leases.items() if p.role == "learner"}
        return len(at_work | {who for who, (role, _) in self._asked.items() if role == "learner"})

    def wanted(self, run: UUID) -> int:
        """How many learners a run wants."""
        demand = self._demands.get(run)
        return 0 if demand is None else demand.learners

    def positions(self) -> dict[UUID, int]:
        """Of every wanted run, how many before it in the queue lack a learner."""
        ahead, positions = 0, {}
        for run in sorted(self._demands, key=lambda run: self._ranks[run]):
            positions[run] = ahead
            places = self._demands[run].places("learner")
            ahead += any(place not in self._leases for place in places)
        return positions

    def missing(self, run: UUID) -> list[Place]:
        """The places that the run wants filled and nobody has."""
        demand = self._demands.get(run)
        if demand is None:
            return []
        roles: tuple[Role, ...] = ("learner", "robot_sim", "edge")
        return [p for role in roles for p in demand.places(role) if p not in self._leases]

    def site_wanted(self, place: Place) -> str | None:
        """The site at which somebody is missing, beside a partner; None: any would do."""
        partner = None if place.role == "learner" else self._leases.get(place.partner)
        return None if partner is None else site_of(partner.worker)

    def vacancies(self) -> Counter[Role]:
        """By role, the places of all runs that nobody has."""
        return Counter(place.role for run in self._demands for place in self.missing(run))

    def runs(self) -> set[UUID]:
        """The runs that someone has a lease of."""
        return {place.run for place in self._leases}

    # Leases

    def candidates(self, role: Role, worker: str, label: str, now_s: float) -> list[Place]:
        """The places that an idle worker could have, the one where it is needed most first.

        Who asks has nothing in hand: what the book says it has is void.

        Args:
            label: where the worker runs; a robot and an edge with equal labels are put together, because
                they share a core, or else those of one host (what is before the "/"). Empty: anywhere.
        """
        self._labels[worker] = label
        self._asked[worker] = role, now_s
        self.expire(now_s)
        for place in list(self._leases):
            self.vanished(place, worker, now_s)
        if now_s < self._quiet_until_s:
            return []
        idle = self._idle(now_s)
        places = [p for p in self._vacant(role) if self._suits(p, worker, idle, now_s)]
        return sorted(places, key=lambda p: self._urgency(p, label, now_s))

    def grant(self, place: Place, worker: str, now_s: float) -> bool:
        """Gives a worker a place, unless somebody has it, or its partner is of another site."""
        if place in self._leases or self._is_apart(place, site_of(worker)):
            return False
        self._leases[place] = Lease(worker, now_s, confirmed=False)
        return True

    def depose(self, place: Place, now_s: float) -> None:
        """Makes a place vacant whose holder does not answer any more, though its token is there."""
        lease = self._leases.pop(place)
        self._left_s[place] = now_s
        self._surplus.setdefault(place, []).append(lease.worker)

    def expire(self, now_s: float) -> None:
        """Drops grants that no token followed in time."""
        for place, lease in list(self._leases.items()):
            if not lease.confirmed and now_s - lease.since_s > GRANT_S:
                del self._leases[place]

    def _vacant(self, role: Role) -> Iterator[Place]:
        """The wanted places of a role that nobody has, in runs that can use it now.

        Slots are of no use before all learners are there, and a learner is of none where there are not as
        many as the run wants to share its updates.
        """
        learners = self.learners()
        for demand in self._demands.values():
            if (
                demand.learners <= learners
                if role == "learner"
                else all(place in self._leases for place in demand.places("learner"))
            ):
                yield from (place for place in demand.places(role) if place not in self._leases)

    def _urgency(self, place: Place, label: str, now_s: float) -> tuple[int, int, int]:
        """Smaller is more urgent.

        Learners that lack others to share updates with get them before another run begins; pairs of robot
        and edge are completed first, then every run gets its first slot.
        """
        rank = self._ranks[place.run]
        if place.role == "learner":
            return not self._has_begun(place.run), rank, place.slot
        return self._fit(place, label, now_s), place.slot, rank

    def _has_begun(self, run: UUID) -> bool:
        """Whether the run has any of its learners."""
        return any(place.run == run and place.role == "learner" for place in self._leases)

    def _fit(self, place: Place, label: str, now_s: float) -> int:
        partner = self._leases.get(place.partner)
        if partner is None:
            return 3
        nearness = near(label, self._labels.get(partner.worker, ""))
        if nearness is None:
            return 2
        if nearness == 0 or self._missing_s(place, partner, now_s) > PATIENCE_S:
            return nearness
        return 3 + nearness  # the one that runs beside the partner will probably ask soon

    # Sites and hosts

    def _is_apart(self, place: Place, site: str) -> bool:
        """Whether the partner at a place is of another site."""
        return self.site_wanted(place) not in (None, site)

    def _suits(self, place: Place, worker: str, idle: Idle, now_s: float) -> bool:
        """Whether a worker may have a place, for all that is known of those who are near its partner."""
        if place.role == "learner":
            return True
        partner = self._leases.get(place.partner)
        if partner is None:  # who begins a pair should be able to complete it
            return idle.is_at(site_of(worker), place.partner.role) or not idle.has_pairs()
        if self._is_apart(place, site_of(worker)):
            return False
        patient = self._missing_s(place, partner, now_s) <= PATIENCE_S
        return not (patient and idle.has_nearer(place.role, worker, partner.worker))

    def _idle(self, now_s: float) -> Idle:
        roles: tuple[Role, ...] = ("robot_sim", "edge")
        return Idle({role: self.idle(role, now_s) for role in roles}, self._labels)

    def _missing_s(self, place: Place, lease: Lease, now_s: float) -> float:
        """For how long a lease's worker has been without the one who should be at `place`."""
        if place in self._leases:
            return 0.0
        return now_s - max(lease.since_s, self._left_s.get(place, lease.since_s))

    # Ends

    def to_release(self, now_s: float) -> list[tuple[Place, str]]:
        """The leases that shall end: those that nobody wants, second ones, and those in vain."""
        leases = [(place, lease.worker) for place, lease in self._leases.items() if lease.confirmed]
        unwanted = [(place, worker) for place, worker in leases if not self._is_wanted(place)]
        in_vain = [(place, worker) for place, worker in leases if self._is_in_vain(place, now_s)]
        surplus = [
            (place, worker) for place, workers in self._surplus.items() for worker in workers
        ]
        apart = [(place, worker) for place, worker in leases if self._came_to_another_site(place)]
        return unwanted + surplus + apart + in_vain

    def _came_to_another_site(self, place: Place) -> bool:
        """Whether the partner is of another site and was there first, or is the robot."""
        lease = self._leases[place]
        if not self._is_apart(place, site_of(lease.worker)):
            return False
        partner = self._leases[place.partner]
        first, second = (partner.since_s, place.role), (lease.since_s, place.partner.role)
        return partner.confirmed and first < second

    def _is_wanted(self, place: Place) -> bool:
        demand = self._demands.get(place.run)
        return demand is not None and place in demand.places(place.role)

    def _is_in_vain(self, place: Place, now_s: float) -> bool:
        """Whether a worker waits here for others while elsewhere others wait for it.

        With few workers one run could keep the robot and another the edge, or each have some of its
        learners, or one the robots and another the learners, and neither go on.
        """
        if not self._is_wanted(place):
            return False
        lease = self._leases[place]
        lacks_learners = any(
            self._missing_s(learner, lease, now_s) > PATIENCE_S
            for learner in self._demands[place.run].places("learner")
        )
        if place.role == "learner":
            return lacks_learners and self._is_of_more_use_elsewhere(place)
        if lacks_learners:
            return any(True for _ in self._vacant(place.role))
        if self._missing_s(place.partner, lease, now_s) <= PATIENCE_S:
            return False
        site, idle = site_of(lease.worker), self._idle(now_s)
        if idle.has_pairs() and not idle.is_at(site, place.partner.role):
            return True  # elsewhere there are both
        return any(
            self._precedence(vacancy) < self._precedence(place)
            and (partner := self._leases.get(vacancy.partner)) is not None
            and site_of(partner.worker) == site
            and self._missing_s(vacancy, partner, now_s) > PATIENCE_S
            for vacancy in self._vacant(place.role)
        )

    def _is_of_more_use_elsewhere(self, place: Place) -> bool:
        """Whether a learner that lacks others is wanted in an older run, or in any other if there are not
        enough learners for its own.
        """
        too_few = self.learners() < self._demands[place.run].learners
        return any(
            too_few or self._ranks[vacancy.run] < self._ranks[place.run]
            for vacancy in self._vacant("learner")
        )

    def _precedence(self, place: Place) -> tuple[int, int]:
        return self._ranks[place.run], place.slot
