"""What keeps a run from going on: the registry ends it with the reason, or says what it waits for."""

import errno
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from uuid import UUID

import msgpack
import pytest
from registry_world import Puppet, Registry, WaitFor, state_of

from bpn_dashboard.registry import dispatcher as dispatching
from bpn_dashboard.registry import releases as releasing
from bpn_dashboard.registry import setbacks
from bpn_dashboard.registry.dispatcher import Dispatcher
from bpn_dashboard.registry.election import Candidate
from bpn_dashboard.registry.leases import Place
from bpn_dashboard.registry.releases import Releases
from bpn_shared.bus import keys
from bpn_shared.bus.requests import RefusedError, Responder, request
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.messages.lease import GiveBack, LeaseRequest, ReleaseReply, Role
from bpn_shared.runtime import leased, watchdog
from bpn_shared.runtime.leased import LeaseLoop
from bpn_shared.runtime.worker import Worker, WorkerProcess
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.version import PROTOCOL

CONFIG = RunConfig.for_task("reaching", iterations=3)
REASON = "cvi needs ONNX Runtime, which is not installed"
Hire = Callable[[Role], Puppet]
GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setbacks, "_PAUSE_S", 0.1)
    monkeypatch.setattr(dispatching, "STALLS_S", 0.05)
    monkeypatch.setattr(watchdog, "STALLED_AFTER_S", 0.5)


@pytest.mark.usefixtures("impatient")
def test_a_place_that_nobody_can_use_fails_the_run_with_the_reason(
    registry: Registry, hire: Hire, open_bus: Callable[[], Bus], wait_for: WaitFor, monkeypatch: Any
) -> None:
    monkeypatch.setattr(leased, "_GIVEN_BACK_S", 0.05)
    row = registry.store.create(CONFIG, actor="test")
    learner = hire("learner")
    learner.work(wait_for)
    registry.store.folder(row.id).set_state("running", new_attempt=True)
    stop, tries = threading.Event(), []
    process = WorkerProcess(kind="edge", id="edge-unable", bus=open_bus(), stop=stop)

    def serve(worker: Worker) -> int:
        tries.append(worker.slot)
        raise ConfigError(REASON)

    loop = threading.Thread(target=LeaseLoop(process, "").run, args=(serve,))
    loop.start()
    try:
        wait_for(registry.running.desk.given_up, "the run to be given up")
    finally:
        stop.set()
        loop.join(10.0)
    error = registry.running.desk.given_up()[row.id]
    assert error.startswith("edge 0 of the run was given back 3 times in a row in iteration 0")
    assert f"the last time by edge-unable: {REASON}" in error
    assert tries == [0, 0, 0]
    wait_for(lambda: learner.released, "its learner to be told")
    assert learner.released[0].reason == error
    learner.give_back()
    wait_for(lambda: state_of(registry, row) == "failed", "the run to fail")
    assert registry.store.get(row.id).error == error
    registry.store.request_resume(row.id, "test")
    wait_for(lambda: state_of(registry, row) == "queued", "the run to be tried again")
    assert registry.running.desk.given_up() == {}


def test_who_can_use_a_place_gets_it_before_who_gave_it_back(
    registry: Registry, hire: Hire, wait_for: WaitFor
) -> None:
    row = registry.store.create(CONFIG, actor="test")
    hire("learner").work(wait_for)
    unable, able = hire("edge"), hire("edge")
    assert unable.work(wait_for).run == row.id
    unable.give_back()
    back = GiveBack(run=row.id, slot=0, reason=REASON)
    assert unable.ask(gave_back=back).status == "wait"
    assert unable.ask().status == "wait"
    assert able.work(wait_for).run == row.id
    assert row.id not in registry.running.desk.given_up()


def test_a_worker_of_another_protocol_is_refused_with_a_sentence(
    registry: Registry, hire: Hire, wait_for: WaitFor
) -> None:
    registry.store.create(CONFIG, actor="test")
    hire("learner").work(wait_for)
    edge = hire("edge")
    sentence = (
        f"edge {edge.id} speaks protocol 1 (bpn 0.0.9), this registry {PROTOCOL}: install bpn "
    )
    with pytest.raises(RefusedError, match=r"speaks protocol 1 \(bpn 0.0.9\)") as refused:
        edge.ask(protocol=1, version="0.0.9")
    assert str(refused.value).startswith(sentence)
    asked = LeaseRequest(role="edge", worker="edge-old")
    old = {"schema": 1} | asked.model_dump(include={"role", "worker", "label"})  # as it once was
    with pytest.raises(RefusedError, match="edge-old speaks protocol 1"):
        request(edge.bus, keys.LEASE_REQUEST_OF_EARLIER, msgpack.packb(old), timeout_s=5.0)
    assert [worker.worker for worker in registry.running.refused()] == [edge.id, "edge-old"]
    newer = msgpack.packb({**msgpack.unpackb(asked.encode()), "schema": 99})
    with pytest.raises(RefusedError, match="schema 99, this program"):
        request(edge.bus, keys.lease_request(), newer, timeout_s=5.0)
    for key in (keys.LEASE_REQUEST_OF_EARLIER, keys.lease_request("lab-b")):  # of this protocol
        mine = asked.model_copy(update={"protocol": PROTOCOL}).encode()
        with pytest.raises(RefusedError, match="edge-old is no worker of site"):
            request(edge.bus, key, mine, timeout_s=5.0)


@pytest.mark.usefixtures("impatient")
def test_a_worker_of_an_older_protocol_that_was_told_its_run_by_hand_is_named_at_the_run(
    registry: Registry, hire: Hire, wait_for: WaitFor
) -> None:
    """It asks for no work, but it tells how it is: here as an edge of protocol 1 (of commit c1cfefb) once did."""
    told = (GOLDEN / "protocol-1" / "telemetry.msgpack").read_bytes()
    row = registry.store.create(CONFIG, actor="test")
    learner = hire("learner")
    learner.work(wait_for)
    registry.store.folder(row.id).set_state("running", new_attempt=True)
    sentence = "edge edge-b2d36365fab3 speaks protocol 1 (a bpn that does not tell its version)"

    def named() -> bool:
        learner.bus.zenoh.put(keys.telemetry("edge", "edge-b2d36365fab3"), told)
        learner.report(row.id)
        return sentence in registry.store.get(row.id).waiting_reason

    wait_for(named, "the old edge to be named")
    (refused,) = registry.running.refused()
    assert refused.reason.startswith(sentence)


def test_a_refused_worker_says_so_and_asks_seldom(
    open_bus: Callable[[], Bus], wait_for: WaitFor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(leased, "_REFUSED_S", 30.0)
    asked: list[float] = []

    def refuse(_body: bytes) -> bytes:
        asked.append(time.monotonic())
        raise RefusedError("edge edge-1 speaks protocol 1")

    registry = Responder(open_bus(), keys.lease_request(), refuse, Counters())
    stop = threading.Event()
    process = WorkerProcess(kind="edge", id="edge-1", bus=open_bus(), stop=stop)
    loop = threading.Thread(target=LeaseLoop(process, "").run, args=(lambda _: 0,))
    loop.start()
    wait_for(lambda: process.waiting.snapshot()[0], "the refusal to be told")
    stop.set()
    loop.join(5.0)
    assert not loop.is_alive()
    assert process.waiting.snapshot()[0] == (
        "the registry, which refuses this worker: edge edge-1 speaks protocol 1"
    )
    assert len(asked) == 1
    registry.close()


@pytest.mark.usefixtures("impatient")
def test_a_run_that_stands_still_says_why_and_no_longer_when_it_goes_on(
    registry: Registry, hire: Hire, wait_for: WaitFor
) -> None:
    first = registry.store.create(CONFIG, actor="test")
    second = registry.store.create(CONFIG, actor="test")

    def reason(row: Any = first) -> str:
        return registry.store.get(row.id).waiting_reason

    wait_for(lambda: reason() == "waits for a learner: 0 connected", "the reason of the first")
    learner = hire("learner")
    registry.running.desk.settle()  # so that it is known, and has no place yet
    learner.ask()
    wait_for(lambda: reason(second) == "1 run before it", "the reason of the second")
    with pytest.raises(RefusedError):
        hire("edge").ask(protocol=1)
    learner.work(wait_for)
    folder = registry.store.folder(first.id)
    folder.set_state("running", new_attempt=True)
    wait_for(lambda: state_of(registry, first) == "running", "the run to be seen running")
    expected = (
        "the learner waits for 3 episodes; 1 robot missing: 0 connected and idle; "
        "1 edge missing: 0 connected and idle; edge edge-2 speaks protocol 1"
    )

    def said() -> bool:
        learner.report(first.id, waiting_for="3 episodes")
        return reason().startswith(expected)

    wait_for(said, "what the run waits for")
    assert registry.store.get(first.id).waiting_since is not None
    assert reason(second) == "waits for a learner: 1 connected, none of them free"
    folder.append_metrics({"iteration": 0, "return_px": -5.0, "length": 20.0, "weights_version": 1})
    wait_for(lambda: not reason(), "the run to be seen going on")
    assert registry.store.get(first.id).waiting_since is None
    registry.store.request_stop(second.id, "test")
    wait_for(lambda: not reason(second), "a run that nobody wants to wait for nothing")


def test_a_learner_that_hangs_with_its_token_loses_its_place_to_an_idle_one(
    registry: Registry, hire: Hire, wait_for: WaitFor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatching, "_SILENT_S", 0.5)
    monkeypatch.setattr(dispatching, "_PROBE_S", 0.2)
    monkeypatch.setattr(dispatching, "_PROBE_AGAIN_S", 0.5)
    row = registry.store.create(CONFIG, actor="test")
    hung, idle = hire("learner"), hire("learner")
    hung.work(wait_for)
    stalls = registry.running.stalls

    def heard() -> bool:
        hung.report(row.id)
        return stalls.silent_s(UUID(row.id), hung.id, time.monotonic()) is not None

    wait_for(heard, "its report to be heard")
    health = Responder(hung.bus, keys.health("learner", hung.id), lambda _: b"{}", Counters())
    begin_s = time.monotonic()
    while time.monotonic() - begin_s < 2.0:  # it says nothing of itself, but it answers
        assert idle.ask().status == "wait"
    health.close()
    assert idle.work(wait_for).run == row.id
    wait_for(lambda: hung.released, "the one that hung to be told")


def test_of_two_registries_on_a_router_one_serves_and_the_other_takes_over(
    registry: Registry, hire: Hire, open_bus: Callable[[], Bus], wait_for: WaitFor,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("bpn_dashboard.registry.election.SETTLE_S", 0.2)
    monkeypatch.setattr("bpn_dashboard.registry.election.MISSED_S", 0.2)
    first = Candidate(registry.bus, "dashboard-b", lambda _: None, Counters())
    wait_for(lambda: first.serves, "the first to serve")
    told: list[bool] = []
    bus = open_bus()
    other = Dispatcher(bus, registry.store, Counters(), leading=False)
    other.start()

    def lead(leading: bool) -> None:
        other.lead(leading)
        told.append(leading)

    second = Candidate(bus, "dashboard-a", lead, Counters())
    wait_for(lambda: second.rival, "the second to see the first")
    assert "serves this router: read-only" in str(second.rival)
    assert not told
    registry.store.create(CONFIG, actor="test")
    learner = hire("learner")
    first.close()
    registry.end()
    wait_for(lambda: told == [True], "the second to take over")
    assert second.rival is None
    learner.work(wait_for)
    second.close()
    other.close()


def test_who_is_to_serve_and_cannot_begin_tries_again(
    registry: Registry, wait_for: WaitFor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bpn_dashboard.registry.election.SETTLE_S", 0.2)
    told: list[bool] = []

    def lead(leading: bool) -> None:
        told.append(leading)
        if len(told) == 1:
            raise OSError(errno.EMFILE, "Too many open files")

    counters = Counters()
    candidate = Candidate(registry.bus, "dashboard-b", lead, counters)
    wait_for(lambda: told == [True, True], "the second try")
    assert candidate.serves
    candidate.close()
    assert told == [True, True]
    assert counters.snapshot() == {"elections_failed": 1}


def test_rounds_that_fail_are_told_once_and_why_nobody_gets_work(
    registry: Registry,
    wait_for: WaitFor,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def none_left(_folder: Path) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    wait_for(lambda: registry.running.trouble is None, "the first round")
    monkeypatch.setattr(dispatching, "_SERVED_WITHIN_S", 0.5)
    with monkeypatch.context() as full:
        full.setattr("bpn_dashboard.registry.index.candidates", none_left)
        full.setattr(dispatching, "ADOPT_S", 0.0)
        registry.running._adopt_at_s = 0.0
        wait_for(lambda: "Too many open files" in str(registry.running.trouble), "the trouble")
        wait_for(lambda: registry.counters.snapshot()["rounds_failed"] > 5, "more rounds")
        assert sum(record.exc_info is not None for record in caplog.records) == 1
    wait_for(lambda: registry.running.trouble is None, "the rounds to go on")


def test_a_worker_that_does_not_let_go_delays_nobody(
    open_bus: Callable[[], Bus], wait_for: WaitFor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(releasing, "_TIMEOUT_S", 60.0)
    asked, thawed = threading.Event(), threading.Event()

    def frozen(_body: bytes) -> bytes:
        asked.set()
        thawed.wait(120)
        return ReleaseReply(working=False).encode()

    worker = Responder(open_bus(), keys.control("edge", "edge-0"), frozen, Counters())
    counters = Counters()
    releases = Releases(open_bus(), counters)
    for _ in range(10):
        releases.tell([(Place(UUID(int=1), "edge", 0), "edge-0", "over")])
    wait_for(asked.is_set, "it to be told")
    assert counters.snapshot() == {}  # nobody has waited for its answer in vain
    thawed.set()
    releases.close()
    assert counters.snapshot() == {}
    worker.close()
