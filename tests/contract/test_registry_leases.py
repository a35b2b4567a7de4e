"""The registry and workers over a real router: who gets what, who is told to let go, what survives whom."""

import shutil
import threading
import time
from collections.abc import Callable
from typing import Any
from uuid import UUID

import pytest
from registry_world import Puppet, Registry, WaitFor, state_of

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry import desk
from bpn_dashboard.registry import dispatcher as dispatching
from bpn_dashboard.registry.queue import move
from bpn_dashboard.registry.view import RegistryView
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import Token
from bpn_shared.bus.requests import RefusedError, Responder, request
from bpn_shared.bus.session import Bus
from bpn_shared.messages.lease import LeaseReply, Role
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runtime.leased import LeaseLoop
from bpn_shared.runtime.worker import Worker, WorkerProcess
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task("reaching", iterations=3)


def test_workers_get_the_oldest_run_and_lose_it_when_it_shall_stop(
    registry: Registry, hire: Callable[[Role], Puppet], wait_for: WaitFor
) -> None:
    learner, edge, idle = hire("learner"), hire("edge"), hire("learner")
    assert learner.ask().status == "wait"
    first = registry.store.create(CONFIG, actor="test")
    second = registry.store.create(CONFIG, actor="test")
    assert learner.work(wait_for).run == first.id
    folder = registry.store.folder(first.id)
    folder.set_state("running", new_attempt=True)
    assert edge.work(wait_for).run == first.id
    wait_for(lambda: registry.store.get(first.id).attempt == 1, "the attempt to be seen")
    assert state_of(registry, first) == "running"

    registry.store.request_stop(first.id, "test")
    assert state_of(registry, first) == "stopping"
    wait_for(lambda: learner.released and edge.released, "both to be told")
    assert learner.released[0].run == edge.released[0].run == first.id
    assert learner.released[0].reason == "the run shall stop"
    wait_for(lambda: len(learner.released) > 1, "a learner that does not let go to be told again")
    folder.set_state("stopped")
    learner.give_back()
    edge.give_back()
    wait_for(lambda: state_of(registry, first) == "stopped", "the run to be seen stopped")
    assert idle.work(wait_for).run == second.id


def test_a_worker_gets_the_run_of_the_highest_priority_and_keeps_the_one_it_has(
    registry: Registry,
    hire: Callable[[Role], Puppet],
    wait_for: WaitFor,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dispatching, "STALLS_S", 0.05)
    worked_on = registry.store.create(CONFIG, actor="test")
    learner = hire("learner")
    learner.work(wait_for)
    oldest, middle, newest = (registry.store.create(CONFIG, actor="test") for _ in range(3))

    def wait_until_last(row: RunRow) -> None:
        def is_last() -> bool:
            return "2 runs before it" in (registry.store.get(row.id).waiting_reason or "")

        wait_for(is_last, "the queue to be in order")

    wait_until_last(newest)
    move(registry.store, [newest.id], "front", "test")
    wait_until_last(middle)
    move(registry.store, [oldest.id], "back", "test")
    wait_until_last(oldest)
    others = [hire("learner") for _ in range(3)]
    got = [other.work(wait_for).run for other in others]
    assert got == [newest.id, middle.id, oldest.id]
    assert not learner.released
    assert registry.store.get(worked_on.id).priority == 0


def test_a_registry_is_alive_while_its_rounds_go_on(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    dispatcher = registry.running
    assert dispatcher is not None
    assert dispatcher.trouble is None
    with monkeypatch.context() as late:
        late.setattr(dispatching, "_SERVED_WITHIN_S", -1.0)
        assert "a round takes longer" in (dispatcher.trouble or "")
    registry.end()
    assert dispatcher.trouble == "its thread has ended"


def test_a_finished_run_is_given_to_nobody_even_before_the_registry_has_seen_it(
    registry: Registry, hire: Callable[[Role], Puppet], wait_for: WaitFor
) -> None:
    row = registry.store.create(CONFIG, actor="test")
    learner, edge = hire("learner"), hire("edge")
    learner.work(wait_for)
    registry.store.folder(row.id).set_state("finished")
    assert edge.ask().status == "wait"
    wait_for(lambda: state_of(registry, row) == "finished", "the end to be seen")
    wait_for(lambda: learner.released, "its learner to be told")


def test_of_runs_that_are_over_or_gone_the_registry_keeps_nothing(
    registry: Registry,
    hire: Callable[[Role], Puppet],
    wait_for: WaitFor,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dispatching, "ADOPT_S", 0.1)
    monkeypatch.setattr(dispatching, "STALLS_S", 0.05)
    dispatcher = registry.running
    assert dispatcher is not None
    finished = registry.store.create(CONFIG, actor="test")
    learner = hire("learner")
    learner.work(wait_for)
    folder = registry.store.folder(finished.id)
    folder.set_state("running", new_attempt=True)
    gone = registry.store.create(CONFIG, actor="test")
    wait_for(lambda: finished.id in dispatcher.view().advanced_unix_s, "its progress to be watched")
    wait_for(lambda: gone.id in dispatcher.view().causes, "what the other one waits for")
    folder.set_state("finished")
    learner.give_back()
    shutil.rmtree(registry.store.folder(gone.id).path)
    wait_for(
        lambda: dispatcher.view() == RegistryView(vacant=dispatcher.view().vacant),
        "both to be forgotten",
    )


def test_a_registry_that_was_away_learns_all_leases_from_the_tokens(
    registry: Registry, hire: Callable[[Role], Puppet], wait_for: WaitFor
) -> None:
    row = registry.store.create(CONFIG, actor="test")
    learner, idle = hire("learner"), hire("learner")
    learner.work(wait_for)
    folder = registry.store.folder(row.id)
    folder.set_state("running", new_attempt=True)
    registry.end()
    folder.append_metrics({"iteration": 0, "return_px": -5.0, "length": 20.0, "weights_version": 1})
    registry.begin()
    wait_for(lambda: registry.store.get(row.id).iteration == 1, "what went on meanwhile to be seen")
    begin_s = time.monotonic()
    while time.monotonic() - begin_s < 2 * desk.SETTLE_S:
        assert idle.ask().status == "wait"
    assert not learner.released
    learner.die()
    assert idle.work(wait_for).run == row.id


def test_a_run_without_a_learner_is_lost_until_another_takes_it(
    registry: Registry, hire: Callable[[Role], Puppet], wait_for: WaitFor
) -> None:
    row = registry.store.create(CONFIG, actor="test")
    learner = hire("learner")
    learner.work(wait_for)
    registry.store.folder(row.id).set_state("running", new_attempt=True)
    wait_for(lambda: state_of(registry, row) == "running", "the run to be seen running")
    learner.die()
    wait_for(lambda: state_of(registry, row) == "lost", "the run to be seen lost")
    hire("learner").work(wait_for)
    wait_for(lambda: state_of(registry, row) == "running", "the run to be seen running again")


def test_a_run_that_kills_its_learners_is_given_up_and_can_be_resumed(
    registry: Registry, hire: Callable[[Role], Puppet], wait_for: WaitFor
) -> None:
    row = registry.store.create(CONFIG, actor="test")
    folder = registry.store.folder(row.id)
    for _ in range(5):
        learner = hire("learner")
        learner.work(wait_for)
        folder.set_state("running", new_attempt=True)
        learner.die()
    wait_for(lambda: state_of(registry, row) == "failed", "the run to be given up")
    assert "5 learners in a row died in iteration 0" in registry.store.get(row.id).error
    assert folder.state().error == registry.store.get(row.id).error
    registry.store.request_resume(row.id, "test")
    hire("learner").work(wait_for)
    wait_for(lambda: state_of(registry, row) == "running", "the run to be seen running")


def test_learners_that_give_a_run_back_or_make_progress_do_not_count(
    registry: Registry, hire: Callable[[Role], Puppet], wait_for: WaitFor
) -> None:
    row = registry.store.create(CONFIG, actor="test")
    folder = registry.store.folder(row.id)
    record: dict[str, Any] = {"return_px": -5.0, "length": 20.0}
    for death in range(6):
        learner = hire("learner")
        learner.work(wait_for)
        folder.set_state("running", new_attempt=True)
        if death % 2:
            folder.append_metrics(record | {"iteration": death, "weights_version": death + 1})
            wait_for(lambda d=death: registry.store.get(row.id).iteration == d + 1, "the progress")
        learner.die()
    learner = hire("learner")
    for _ in range(6):
        learner.work(wait_for)
        learner.give_back()
        wait_for(lambda: state_of(registry, row) == "lost", "the run to be seen lost")
    learner.work(wait_for)
    wait_for(lambda: state_of(registry, row) == "running", "the run to go on")


def test_a_run_that_another_program_learns_is_shown_and_left_alone(
    registry: Registry, hire: Callable[[Role], Puppet], wait_for: WaitFor, monkeypatch: Any
) -> None:
    monkeypatch.setattr(dispatching, "ADOPT_S", 0.1)
    folder = RunFolder.create(registry.store.runs_dir, UUID(int=7), CONFIG)
    with folder.owned("somebody"):
        folder.set_state("running", new_attempt=True)

        def shown() -> bool:
            return [row.state for row in registry.store.find()] == ["running"]

        wait_for(shown, "the run to be shown")
        assert hire("learner").ask().status == "wait"
        registry.store.request_resume(str(folder.run), "test")
        learner = hire("learner")
        assert learner.ask().status == "wait"
    wait_for(lambda: learner.ask().run == str(folder.run), "a lease once nobody owns it")


def test_garbage_is_refused_and_the_registry_goes_on(
    registry: Registry,
    hire: Callable[[Role], Puppet],
    open_bus: Callable[[], Bus],
    wait_for: WaitFor,
) -> None:
    bus = open_bus()
    tokens = [
        Token(bus, keys.lease(run, role, slot, "x"))
        for run, role, slot in (
            ("no-uuid", "edge", 0), (UUID(int=1), "cook", 0), (UUID(int=1), "edge", "first"),
            (UUID(int=1), "edge", 0),
        )
    ]  # fmt: skip
    for body in (b"", b"\xff" * 100, LeaseReply(status="wait").encode()):
        with pytest.raises(RefusedError):
            request(bus, keys.lease_request(), body, timeout_s=5.0)
    wait_for(lambda: registry.counters.snapshot().get("tokens_refused") == 3, "three refusals")
    assert registry.counters.snapshot()["requests_refused"] == 3
    row = registry.store.create(CONFIG, actor="test")
    assert hire("learner").work(wait_for).run == row.id
    del tokens


def test_a_worker_goes_from_lease_to_lease_and_takes_nothing_along(
    registry: Registry, open_bus: Callable[[], Bus], wait_for: WaitFor
) -> None:
    stop = threading.Event()
    process = WorkerProcess(kind="learner", id="learner-0", bus=open_bus(), stop=stop)
    served: list[Worker] = []

    def serve(worker: Worker) -> int:
        answer = Responder(worker.bus, keys.config(worker.run), lambda _: b"yes", worker.counters)
        served.append(worker)
        worker.stop.wait(20.0)
        registry.store.folder(str(worker.run)).set_state("stopped")
        del answer
        return 0

    loop = threading.Thread(target=LeaseLoop(process, "").run, args=(serve,))
    loop.start()
    observer = open_bus()
    threads: list[int] = []
    for number in range(3):
        row = registry.store.create(CONFIG, actor="test")
        wait_for(lambda n=number: len(served) == n + 1, "the run to be served")
        assert str(served[-1].run) == row.id
        assert request(observer, keys.config(UUID(row.id)), b"", timeout_s=5.0) == b"yes"
        threads.append(threading.active_count())
        registry.store.request_stop(row.id, "test")
        wait_for(lambda r=row: state_of(registry, r) == "stopped", "the run to be seen stopped")
    assert len({id(worker.bus) for worker in served}) == 3
    assert all(worker.counters is process.counters for worker in served)
    assert threads[1] == threads[2]
    stop.set()
    loop.join(10.0)
    assert not loop.is_alive()


def test_a_worker_that_cannot_use_a_lease_gives_it_back(
    registry: Registry, open_bus: Callable[[], Bus], wait_for: WaitFor
) -> None:
    stop = threading.Event()
    process = WorkerProcess(kind="learner", id="learner-0", bus=open_bus(), stop=stop)
    row = registry.store.create(CONFIG, actor="test")
    folder = registry.store.folder(row.id)
    tried = threading.Event()

    def serve(worker: Worker) -> int:
        with folder.owned("me"):
            pass
        with folder.owned("a"), folder.owned(worker.id, patience_s=0.0):
            tried.set()  # never
        return 0

    loop = threading.Thread(target=LeaseLoop(process, "").run, args=(serve,))
    loop.start()
    wait_for(lambda: state_of(registry, row) == "running", "the run to be leased")
    wait_for(lambda: state_of(registry, row) == "queued", "the run to be given back")
    assert not tried.is_set()
    stop.set()
    loop.join(10.0)
    assert not loop.is_alive()
