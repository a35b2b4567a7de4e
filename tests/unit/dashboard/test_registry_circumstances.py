from uuid import UUID

import pytest

from bpn_dashboard.registry.circumstances import Queue, around
from bpn_dashboard.registry.leases import Demand, LeaseBook, Place
from bpn_dashboard.registry.setbacks import GiveBack, Setbacks
from bpn_dashboard.registry.versions import FORGET_S, Refused, RefusedWorkers, why_refused
from bpn_shared.messages.lease import LeaseRequest
from bpn_shared.runtime.service import new_worker_id
from bpn_shared.runtime.watchdog import Circumstances
from bpn_shared.version import PROTOCOL, VERSION

A = UUID(int=1)


def queue(book: LeaseBook, run: UUID = A) -> str:
    return around(run, book, Queue.of(book), Setbacks(), now_s=0.0).queue


def book_of(*runs: Demand) -> LeaseBook:
    book = LeaseBook()
    book.demand(runs)
    return book


@pytest.mark.parametrize(
    ("before", "said"),
    [
        (0, "waits for a learner: 1 connected, none of them free"),
        (1, "1 run before it"),
        (2, "2 runs before it"),
        (10, "10 runs before it"),
        (11, "more than 10 runs before it"),
        (500, "more than 10 runs before it"),
    ],
)
def test_a_queued_run_knows_how_many_are_before_it(before: int, said: str) -> None:
    others = [Demand(UUID(int=100 + n), 1) for n in range(before)]
    book = book_of(*others, Demand(A, 1))
    book.candidates("learner", "l0", "", 0.0)
    assert queue(book) == said


def test_a_queued_run_says_how_many_learners_there_are_if_too_few() -> None:
    book = book_of(Demand(A, 1, 2))
    assert queue(book) == "waits for 2 learners: 0 connected"
    book.candidates("learner", "l0", "", 0.0)
    assert queue(book) == "waits for 2 learners: 1 connected"
    assert queue(book_of(Demand(A, 1))) == "waits for a learner: 0 connected"


def test_a_run_with_its_learners_says_who_else_is_missing_or_gave_the_place_back() -> None:
    book, setbacks = book_of(Demand(A, 2)), Setbacks()
    book.appeared(Place(A, "learner", 0), "l0", 0.0)
    book.appeared(Place(A, "robot_sim", 0), "r0", 0.0)
    book.candidates("edge", "e0", "", 0.0)
    setbacks.gave_back(GiveBack(Place(A, "edge", 1), "e0", "no ONNX Runtime", 0), set(), 0.0)
    refused = [Refused("edge", "e9", "edge e9 is old", 0.0), Refused("learner", "l9", "l9 is", 0.0)]
    assert around(A, book, Queue.of(book), setbacks, refused=refused, now_s=0.0) == Circumstances(
        lacking=(
            "e0 gave it back: no ONNX Runtime",
            "1 robot missing: 0 connected and idle",
            "2 edges missing: 1 connected and idle",
        ),
        refused=("edge e9 is old",),
    )


def test_of_a_run_without_a_learner_only_learners_that_are_refused_are_told() -> None:
    refused = [Refused("edge", "e9", "edge e9 is old", 0.0), Refused("learner", "l9", "l9 is", 0.0)]
    book = book_of(Demand(A, 1))
    known = around(
        A,
        book,
        Queue.of(book),
        Setbacks(),
        refused=refused,
        now_s=0.0,
        owner="learner-x",
        disk="full",
    )
    assert known.refused == ("l9 is",)
    assert known.owner == "its folder is held by learner-x, of whom nothing is heard"
    assert known.disk == "full"


def test_a_run_whose_router_another_dashboard_serves_waits_for_nothing_else() -> None:
    said = "another dashboard (host, pid 12) serves this router: read-only"
    book = book_of(Demand(A, 1))
    assert around(A, book, Queue.of(book), Setbacks(), now_s=0.0, read_only=said).queue == said
    book.appeared(Place(A, "learner", 0), "l0", 0.0)  # the other one's, of a folder of both
    assert around(A, book, Queue.of(book), Setbacks(), now_s=0.0, read_only=said).queue == ""


def test_a_refused_worker_is_told_what_to_install_and_remembered_while_it_asks() -> None:
    asked = LeaseRequest(role="edge", worker="edge-12", version="0.0.9")
    reason = why_refused(asked)
    assert reason == (
        f"edge edge-12 speaks protocol 1 (bpn 0.0.9), this registry {PROTOCOL}: install bpn {VERSION} there"
    )
    assert why_refused(asked.model_copy(update={"protocol": PROTOCOL})) is None
    assert "a bpn that does not tell" in str(why_refused(asked.model_copy(update={"version": ""})))
    refusals = RefusedWorkers()
    refusals.note("edge", "edge-12", reason, 0.0)
    refusals.note("edge", "edge-12", reason, 60.0)
    (refused,) = refusals.current(60.0 + FORGET_S)
    assert (refused.worker, refused.reason, refused.at_s) == ("edge-12", reason, 60.0)
    assert refusals.current(60.1 + FORGET_S) == []


def test_a_worker_whose_token_tells_another_protocol_is_named_while_it_is_there() -> None:
    refusals, other = RefusedWorkers(), f"edge-p{PROTOCOL + 1}-0123456789ab"
    for worker in (new_worker_id("edge"), "edge-0123456789ab", other):
        refusals.appeared("edge", worker, 1.0)
    (refused,) = refusals.current(1e6)
    assert refused.worker == other
    assert refused.reason.startswith(
        f"edge {other} speaks protocol {PROTOCOL + 1} (as its token tells), this registry {PROTOCOL}: install"
    )
    refusals.gone(other)
    assert refusals.current(1e6) == []


def test_who_is_missing_beside_a_partner_is_missing_at_its_site() -> None:
    book = book_of(Demand(A, 3))
    book.appeared(Place(A, "learner", 0), "l0", 0.0)
    book.appeared(Place(A, "robot_sim", 0), "lab-b.r0", 0.0)
    book.appeared(Place(A, "robot_sim", 1), "r1", 0.0)
    for worker in ("e0", "e1", "lab-c.e2"):
        book.candidates("edge", worker, "", 0.0)
    lacking = around(A, book, Queue.of(book), Setbacks(), now_s=0.0).lacking
    assert lacking == (
        "1 robot missing: 0 connected and idle",
        "1 edge missing at site lab-b: 0 connected and idle there, 3 at other sites",
        "1 edge missing at site main: 2 connected and idle there, 1 at other sites",
        "1 edge missing: 3 connected and idle",
    )
