"""A robot and its edge are of one site, always; of one host or core, if that can be had."""

import itertools

from hypothesis import given
from hypothesis import strategies as st
from lease_books import A, ask, filled

from bpn_dashboard.registry.leases import PATIENCE_S, Demand, LeaseBook, Place
from bpn_shared.messages.lease import Role
from bpn_shared.site import site_of

ROBOT, EDGE = Place(A, "robot_sim", 0), Place(A, "edge", 0)


def book_of(slots: int = 1) -> LeaseBook:
    book = LeaseBook()
    book.demand([Demand(A, slots)])
    filled(book, "learner", "l0")
    return book


def test_an_edge_of_another_site_never_gets_the_place_beside_a_robot() -> None:
    book = book_of()
    filled(book, "robot_sim", "lab-a.r")
    for now_s in (1.0, 4.0, 8.0, 100.0, 10_000.0):
        for stranger in ("lab-b.e", "e"):
            assert ask(book, "edge", stranger, "", now_s) is None
    assert book.to_release(10_000.0) == []
    assert filled(book, "edge", "lab-a.e", now_s=10_001.0) == EDGE


def test_what_was_free_when_it_was_offered_may_be_anothers_when_it_is_granted() -> None:
    book = book_of()
    assert ROBOT in book.candidates("robot_sim", "lab-a.r", "", 0.0)
    assert EDGE in book.candidates("edge", "lab-b.e", "", 0.0)
    assert book.grant(ROBOT, "lab-a.r", 0.0)
    assert not book.grant(EDGE, "lab-b.e", 0.0)


def test_who_has_no_partner_at_its_site_leaves_the_place_to_a_site_that_has_both() -> None:
    book = book_of()
    assert ask(book, "edge", "lab-b.e", "", 0.0) == EDGE  # who else?
    book.vanished(EDGE, "lab-b.e", 0.0)
    for role, worker in (("robot_sim", "lab-a.r"), ("edge", "lab-a.e")):
        book.candidates(role, worker, "", 1.0)  # type: ignore[arg-type]
    assert ask(book, "edge", "lab-b.e", "", 1.0) is None
    assert filled(book, "robot_sim", "lab-a.r", now_s=1.0) == ROBOT
    assert filled(book, "edge", "lab-a.e", now_s=1.0) == EDGE


def test_a_robot_without_an_edge_at_its_site_gives_way_to_a_pair_elsewhere() -> None:
    book = book_of()
    filled(book, "robot_sim", "lab-a.r")
    late_s = PATIENCE_S + 1
    assert ask(book, "edge", "lab-b.e", "", late_s) is None
    assert book.to_release(late_s) == []  # one alone is of no more use
    assert ask(book, "robot_sim", "lab-b.r", "", late_s) is None
    assert book.to_release(late_s) == [(ROBOT, "lab-a.r")]
    book.vanished(ROBOT, "lab-a.r", late_s)
    assert ask(book, "robot_sim", "lab-a.r", "", late_s) is None
    assert filled(book, "robot_sim", "lab-b.r", now_s=late_s) == ROBOT
    assert filled(book, "edge", "lab-b.e", now_s=late_s) == EDGE


def test_tokens_of_two_sites_at_one_slot_do_not_stay() -> None:
    book = book_of()
    book.appeared(EDGE, "lab-b.e", 1.0)
    book.appeared(ROBOT, "lab-a.r", 2.0)
    assert book.to_release(3.0) == [(ROBOT, "lab-a.r")]
    book.vanished(EDGE, "lab-b.e", 3.0)
    assert book.to_release(3.0) == []
    book.appeared(EDGE, "lab-b.e", 2.0)  # at the same time: the robot stays
    assert book.to_release(3.0) == [(EDGE, "lab-b.e")]


def test_a_place_is_kept_for_an_idle_edge_of_the_robots_host_but_not_for_long() -> None:
    book = book_of()
    filled(book, "robot_sim", "r", "h1/0")
    assert ask(book, "edge", "far", "h2/0", 0.5) == EDGE  # nobody nearer is known
    book.vanished(EDGE, "far", 0.5)
    book.vanished(ROBOT, "r", 0.5)
    book.candidates("edge", "near", "h1/1", 1.0)
    filled(book, "robot_sim", "r", "h1/0", 1.0)
    assert ask(book, "edge", "far", "h2/0", 1.1) is None
    assert ask(book, "edge", "silent", "", 1.1) is None
    assert ask(book, "edge", "near", "h1/1", 1.2) == EDGE
    book.vanished(EDGE, "near", 1.2)
    late_s = 1.2 + PATIENCE_S + 1
    book.candidates("edge", "near", "h1/1", late_s - 1)  # asks, and is not given it
    assert ask(book, "edge", "far", "h2/0", late_s) == EDGE


def test_of_two_places_the_one_beside_its_own_host_is_preferred() -> None:
    book = book_of(2)
    filled(book, "robot_sim", "r0", "h1/0")
    filled(book, "robot_sim", "r1", "h2/0")
    late_s = PATIENCE_S + 1
    assert ask(book, "edge", "e", "h2/7", late_s) == Place(A, "edge", 1)


WORKERS: list[tuple[Role, str]] = [
    (role, f"{site}{role[0]}{number}")
    for role, site, number in itertools.product(
        ("robot_sim", "edge"), ("", "lab-a.", "lab-b."), range(2)
    )
]
events = st.lists(
    st.tuples(
        st.sampled_from(("ask", "leave", "token")), st.sampled_from(WORKERS), st.integers(0, 12)
    ),
    max_size=60,
)


@given(events)
def test_whatever_happens_no_slot_is_granted_to_two_sites(
    happened: list[tuple[str, tuple[Role, str], int]],
) -> None:
    book, now_s, where = book_of(3), 0.0, dict[str, Place]()
    for what, (role, worker), pause_s in happened:
        now_s += pause_s
        if what == "ask" and worker not in where:
            if (place := ask(book, role, worker, "", now_s)) is not None:
                where[worker] = place
        elif what == "token" and worker in where:
            book.appeared(where[worker], worker, now_s)
        elif what == "leave" and worker in where:
            book.vanished(where.pop(worker), worker, now_s)
        for place, worker_there in book.to_release(now_s):
            assert site_of(worker_there) == site_of(book.holder(place.partner) or worker_there)
        for slot in range(3):
            pair = [book.holder(Place(A, role, slot)) for role in ("robot_sim", "edge")]
            assert len({site_of(worker) for worker in pair if worker}) <= 1
