"""What the registry knows of a run that may stand still: its place in the queue, and who lacks."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple
from uuid import UUID

from bpn_dashboard.registry.leases import LeaseBook, Place
from bpn_dashboard.registry.setbacks import Setbacks
from bpn_dashboard.registry.versions import Refused
from bpn_shared.runtime.watchdog import Circumstances
from bpn_shared.site import MAIN_SITE, site_of

_MANY = 10


class Queue(NamedTuple):
    """What all runs that wait for learners have in common.

    Attributes:
        learners: how many there are.
        positions: of every wanted run, how many before it lack one.
    """

    learners: int
    positions: Mapping[UUID, int]

    @classmethod
    def of(cls, book: LeaseBook) -> "Queue":
        """As it is now."""
        return cls(book.learners(), book.positions())


def around(
    run: UUID,
    book: LeaseBook,
    queue: Queue,
    setbacks: Setbacks,
    *,
    refused: Iterable[Refused] = (),
    now_s: float,
    owner: str | None = None,
    read_only: str = "",
    router: str = "",
    disk: str = "",
) -> Circumstances:
    """What is to be said about a wanted run.

    Args:
        owner: who holds its folder although no worker of ours is its learner.
        read_only: which other dashboard gives workers their work, if one does.
        router, disk: what is wrong with them, if anything is.
    """
    missing = book.missing(run)
    roles = {place.role for place in missing}
    if "learner" in roles:  # nobody else is of use before
        roles = {"learner"}
    waits = _queue(run, book, queue, setbacks, missing)
    if read_only and "learner" in roles:  # learners ask the other one, and are not known here
        waits = iter([read_only])
    return Circumstances(
        router=router,
        queue="; ".join(waits),
        owner=f"its folder is held by {owner}, of whom nothing is heard" if owner else "",
        lacking=tuple(_lacking(book, setbacks, missing, now_s)),
        refused=tuple(worker.reason for worker in refused if worker.role in roles),
        disk=disk,
    )


def _queue(
    run: UUID, book: LeaseBook, queue: Queue, setbacks: Setbacks, missing: list[Place]
) -> Iterator[str]:
    learners = [place for place in missing if place.role == "learner"]
    if not learners:
        return
    yield from filter(None, map(setbacks.newest, learners))
    known, wanted, ahead = queue.learners, book.wanted(run), queue.positions.get(run, 0)
    if known < wanted:
        yield f"waits for {'a learner' if wanted == 1 else f'{wanted} learners'}: {known} connected"
    elif ahead > _MANY:
        yield f"more than {_MANY} runs before it"
    elif ahead:
        yield f"{ahead} run{'s' if ahead > 1 else ''} before it"
    else:
        yield f"waits for a learner: {known} connected, none of them free"


def _lacking(
    book: LeaseBook, setbacks: Setbacks, missing: list[Place], now_s: float
) -> Iterator[str]:
    places = [place for place in missing if place.role != "learner"]
    yield from filter(None, map(setbacks.newest, places))
    idle = {p.role: [site_of(one) for one in book.idle(p.role, now_s)] for p in places}
    wanted = Counter((p.role, _site(book, p, idle[p.role])) for p in places)
    for (role, site), count in wanted.items():
        name, known = role.removesuffix("_sim") + ("s" if count > 1 else ""), idle[role]
        if site is None:
            yield f"{count} {name} missing: {len(known)} connected and idle"
        else:  # whoever is idle elsewhere is of no use
            there = known.count(site)
            yield (
                f"{count} {name} missing at site {site}: {there} connected and idle there, "
                f"{len(known) - there} at other sites"
            )


def _site(book: LeaseBook, place: Place, idle: list[str]) -> str | None:
    """Where somebody is missing; None: anywhere, or there is one site only."""
    site = book.site_wanted(place)
    return None if site is None or {site, *idle} == {MAIN_SITE} else site
