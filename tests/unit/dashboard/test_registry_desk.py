"""The desk where workers ask for work, without a network: what tokens and questions make of it."""

import time
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry import desk as module
from bpn_dashboard.registry.desk import LeaseDesk
from bpn_dashboard.registry.leases import Place
from bpn_shared.bus import keys
from bpn_shared.bus.requests import RefusedError
from bpn_shared.counters import Counters
from bpn_shared.messages.lease import GiveBack, LeaseReply, LeaseRequest, Role
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig
from bpn_shared.version import PROTOCOL

RUN, OTHER = UUID(int=1), UUID(int=2)
LEARNER = Place(RUN, "learner", 0)


class Desk:
    """A desk with one run that wants a learner, an edge and a robot, and how often it told news."""

    def __init__(self, runs_dir: Path) -> None:
        self.news: list[int] = []
        self.counters = Counters()
        self.folder = RunFolder.create(runs_dir, RUN, RunConfig.for_task("reaching"))
        self.desk = LeaseDesk(lambda _: self.folder, lambda: self.news.append(1), self.counters)
        self.demand()

    def demand(self, **more: Any) -> None:
        row = {"id": str(RUN), "iteration": 3, "config": {"robots": 1}}
        self.desk.demand([RunRow(**row | more)])

    def ask(self, worker: str, role: Role = "learner", **more: Any) -> tuple[str, str | None, int]:
        told = {"role": role, "worker": worker, "protocol": PROTOCOL} | more
        reply = LeaseReply.decode(self.desk.answer(LeaseRequest(**told).encode()))
        return reply.status, reply.run, reply.slot

    def token(self, worker: str, there: bool, role: Role = "learner") -> None:
        self.desk.on_lease(keys.lease(RUN, role, 0, worker), there)


@pytest.fixture
def at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    monkeypatch.setattr(module, "SETTLE_S", 0.0)
    return Desk(tmp_path)


LEASE, WAIT = ("lease", str(RUN), 0), ("wait", None, 0)


def test_each_place_is_given_once_and_again_when_it_was_left(at: Desk) -> None:
    assert at.ask("a") == LEASE
    assert at.ask("b") == WAIT
    at.token("a", True)
    assert at.desk.occupation() == ({str(RUN)}, {str(RUN)})
    at.token("a", False)
    assert len(at.news) == 2
    assert at.desk.occupation() == (set(), set())
    assert at.ask("b") == WAIT  # it is not noted yet how far the first one came
    (loss,) = at.desk.unnoted()
    at.desk.note(loss, 3)
    assert at.ask("b") == LEASE
    assert at.ask("e", "edge") == LEASE
    assert at.desk.occupation() == ({str(RUN)}, set())  # granted is not yet there


def test_a_run_that_is_over_or_unknown_is_given_to_nobody(at: Desk) -> None:
    at.folder.set_state("finished")
    assert at.ask("a") == WAIT
    at.desk.demand([])
    assert at.ask("b") == WAIT


def test_another_router_lets_tokens_come_back_first(
    at: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    at.token("a", True)
    at.token("a", False)
    assert [loss.worker for loss in at.desk.unnoted()] == ["a"]
    monkeypatch.setattr(module, "SETTLE_S", 60.0)
    at.desk.on_router("router-1")
    assert at.desk.unnoted() == []  # it was the router that it lost
    assert at.ask("b") == WAIT
    monkeypatch.setattr(module, "SETTLE_S", 0.0)
    at.desk.on_router("router-1")
    assert at.ask("b") == WAIT  # the same one: nothing new
    at.desk.on_router("")
    assert at.ask("b") == LEASE


def test_settling_grants_nothing(at: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SETTLE_S", 60.0)
    at.desk.settle()
    assert at.ask("a") == WAIT


@pytest.mark.parametrize("key", [
    "bpn/lease/nowhere/learner/0/a", f"bpn/lease/{RUN}/cook/0/a", f"bpn/lease/{RUN}/learner/x/a",
])  # fmt: skip
def test_what_is_no_leases_token_is_counted_and_nothing_else(at: Desk, key: str) -> None:
    at.desk.on_lease(key, True)
    assert at.counters.snapshot()["tokens_refused"] == 1
    assert key in at.counters.reasons()["tokens_refused"]
    assert (at.news, at.desk.occupation().held) == ([], set())


def test_who_speaks_another_protocol_is_refused_and_remembered(at: Desk) -> None:
    with pytest.raises(RefusedError, match=f"speaks protocol {PROTOCOL + 1}"):
        at.ask("a", protocol=PROTOCOL + 1, gpu=True)
    assert [(r.role, r.worker) for r in at.desk.refused()] == [("learner", "a")]
    assert at.desk.told() == []
    assert at.ask("b") == LEASE


def test_workers_and_what_they_told_are_known_while_their_tokens_are_there(at: Desk) -> None:
    for worker, gpu in (("a", True), ("b", False), ("c", None)):
        at.desk.on_worker(keys.live("learner", worker), True)
        at.ask(worker, gpu=gpu)
    assert at.desk.alive() == {"a", "b", "c"}
    assert [told.gpu for told in at.desk.told()] == [True, False, None]
    assert at.desk.replaceable(time.monotonic()) == []  # nobody's token is at a place
    at.token("a", True)
    assert at.desk.replaceable(time.monotonic()) == [(LEARNER, "a")]
    for worker in ("b", "c"):
        at.desk.on_worker(keys.live("learner", worker), False)
    assert (at.desk.alive(), [told.gpu for told in at.desk.told()]) == ({"a"}, [True])
    assert at.desk.replaceable(time.monotonic()) == []  # nobody is left who could replace it


def test_a_deposed_learners_place_is_free_and_its_token_does_not_take_it_back(at: Desk) -> None:
    at.token("a", True)
    at.desk.depose(LEARNER, "b")
    assert at.desk.occupation().owned == {str(RUN)}  # it is not the other's
    at.desk.depose(LEARNER, "a")
    assert at.desk.occupation().owned == set()
    assert at.ask("b") == LEASE


def lose(at: Desk, worker: str, iteration: int | None = 3) -> None:
    """A learner's place and life end."""
    at.token(worker, True)
    at.token(worker, False)
    (loss,) = at.desk.unnoted()
    at.desk.note(loss, iteration)


LATER_S = 1e6


def test_learners_that_die_in_one_iteration_fail_the_run_until_it_is_forgotten(at: Desk) -> None:
    for worker in "abcde":
        assert at.desk.given_up() == {}
        lose(at, worker)
        at.desk.count_deaths(time.monotonic() + LATER_S)
    (reason,) = at.desk.given_up().values()
    assert reason.startswith("5 learners in a row died in iteration 3, the last was e")
    assert at.counters.snapshot()["learner_deaths"] == 5
    assert at.ask("g") == WAIT
    at.demand()
    at.desk.forget(str(RUN))
    at.demand()
    assert at.desk.given_up() == {}
    assert at.ask("g") == LEASE


@pytest.mark.parametrize("why", ["gave back", "lives", "not running", "not wanted", "too soon"])
def test_what_is_no_death_does_not_count(at: Desk, why: str) -> None:
    for worker in "abcdefgh":
        lose(at, worker, None if why == "not running" else 3)
        if why == "gave back":
            at.ask(worker)
        if why == "lives":
            at.desk.on_worker(keys.live("learner", worker), True)
        if why == "not wanted":
            at.desk.demand([])
        at.desk.count_deaths(time.monotonic() + (0 if why == "too soon" else LATER_S))
    assert at.desk.given_up() == {}


def test_a_place_that_every_idle_worker_gave_back_fails_the_run(at: Desk) -> None:
    def give_back(run: UUID) -> dict[str, Any]:
        return {"gave_back": GiveBack(run=str(run), slot=0, reason="no such camera")}

    at.ask("a", "edge", **give_back(OTHER))  # of a run that nobody wants any more
    assert at.desk.given_up() == {}
    for _ in range(20):
        at.ask("a", "edge", **give_back(RUN))
    assert "no such camera" in at.desk.given_up()[str(RUN)]
    assert at.news
