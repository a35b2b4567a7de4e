"""Workers that ask a lease book for places."""

from uuid import UUID

from bpn_dashboard.registry.leases import LeaseBook, Place
from bpn_shared.messages.lease import Role

ROLES: tuple[Role, ...] = ("learner", "robot_sim", "edge")
A, B = UUID(int=1), UUID(int=2)
"""Runs."""


def ask(book: LeaseBook, role: Role, worker: str, label: str, now_s: float) -> Place | None:
    """The first place that the worker could have is given to it."""
    for place in book.candidates(role, worker, label, now_s):
        assert book.grant(place, worker, now_s)
        return place
    return None


def filled(book: LeaseBook, role: Role, worker: str, label: str = "", now_s: float = 0.0) -> Place:
    """The place that the worker is given, and takes."""
    place = ask(book, role, worker, label, now_s)
    assert place is not None
    book.appeared(place, worker, now_s)
    return place
