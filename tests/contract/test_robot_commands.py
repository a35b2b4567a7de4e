"""What a robot is commanded, whatever its edge does: actions, to hold, to stop; and that this is what is told."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from journal_robot import JOURNAL, JournalRobot, read, spec
from loop_parts import Running
from robot_edge import EdgeSide

from bpn_robot.commands import Commands
from bpn_robot.robots import make_robot
from bpn_robot.service import RobotService
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.messages.frame import FrameKind
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import ConfigError, RunConfig

TASK = spec()
HOLD = TASK.hold_action
WaitFor = Callable[..., None]
Begin = Callable[..., tuple[Running, EdgeSide]]


def configured(pacing: str, steps: int) -> RunConfig:
    config = RunConfig.for_task("reaching", hidden_units=16, steps=steps, pacing=pacing)
    return config.model_copy(update={"task_spec": TASK})


def serve(worker: Worker, config: RunConfig) -> int:
    service = RobotService(worker, config, JournalRobot(TASK))
    try:
        service.run()
    finally:
        service.close()
    return 0


@pytest.fixture
def journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "journal"
    monkeypatch.setenv(JOURNAL, str(path))
    return path


@pytest.fixture
def begin(journal: Path, running: Callable[..., Running], open_bus: Callable[[], Bus]) -> Begin:
    del journal
    return lambda config: (running("robot_sim", serve, config), EdgeSide(open_bus(), config))


def calls(journal: Path) -> list[Any]:
    """What the robot was told, in order: actions by their numbers."""
    return [entry.argument if entry.call == "command" else entry.call for entry in read(journal)]


def of_episode(journal: Path, seed: int) -> list[Any]:
    """What it was told between the reset with that seed and the next."""
    entries = read(journal)
    begin = next(i for i, entry in enumerate(entries) if entry[2:] == ("reset", seed))
    end = next(i for i, entry in enumerate(entries) if i > begin and entry.call == "reset")
    return calls(journal)[begin + 1 : end]


@given(answers=st.lists(st.sampled_from([None, 0, 1]), min_size=4, max_size=4))
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_in_realtime_what_a_frame_tells_of_was_commanded(
    answers: list[int | None], playing: tuple[Running, EdgeSide], journal: Path
) -> None:
    """An answer may come too late on a busy machine; then it is told, and commanded, that the robot holds."""
    _, edge = playing
    reset_id = edge.new_reset()
    for step, answer in enumerate(answers):
        edge.frame(step, reset_id)
        if answer is not None:
            edge.act(answer, step, reset_id)
    assert edge.frame(4, reset_id)[0].kind == FrameKind.LAST
    told = [edge.frame(step, reset_id)[0].applied_action for step in range(1, 5)]
    assert all(found in (given, HOLD) for found, given in zip(told, answers, strict=True))
    edge.frame(0, edge.new_reset())  # so all that belongs to the episode is in the journal
    assert of_episode(journal, seed=reset_id) == [*told, "stop"]


@pytest.fixture
def playing(begin: Begin) -> tuple[Running, EdgeSide]:
    return begin(configured("realtime", 4))


def test_in_realtime_a_robot_that_hears_nothing_holds_and_then_stops(
    begin: Begin, journal: Path, wait_for: WaitFor
) -> None:
    config = configured("realtime", 200)
    robot, edge = begin(config)
    edge.reset(5)
    for step, action in enumerate((0, 1)):
        edge.frame(step, 5)
        edge.act(action, step, 5)
    wait_for(lambda: robot.counters.get("episodes_deserted") == 1, "the robot to give up")
    first, begun, *rest = calls(journal)
    assert (first, begun, rest[-1]) == ("stop", "reset", "stop")
    holds = [call for call in rest[:-1] if call not in (0, 1)]
    assert set(holds) == {HOLD}
    assert len(holds) >= config.longest_silence_s / TASK.control_period_s / 2
    assert rest[:-1][-len(holds) + 2 :] == holds[2:]  # nothing but holding once it is silent
    sent = len(edge.frames)
    assert sent < 200
    edge.reset(5)  # the edge is back, and asks for the same episode
    edge.frame(0, 5, count=2)
    assert calls(journal)[2 + len(rest)] == "reset"


def test_a_late_edge_is_no_silent_one(begin: Begin, journal: Path) -> None:
    """Its actions come too late, always: the robot holds, and the episode goes on to its end."""
    config = configured("realtime", 40)
    robot, edge = begin(config)
    edge.reset(5)
    for step in range(1, 40):
        edge.frame(step, 5)
        edge.act(0, step - 1, 5)
    last, _ = edge.frame(40, 5)
    assert (last.kind, last.deadline_misses) == (FrameKind.LAST, 40)
    assert "episodes_deserted" not in robot.counters
    assert calls(journal)[:42] == ["stop", "reset", *[HOLD] * 40]


def test_in_lockstep_a_robot_that_waits_for_long_is_stopped_once_and_goes_on(
    begin: Begin, journal: Path, wait_for: WaitFor
) -> None:
    robot, edge = begin(configured("lockstep", 3))
    edge.reset(5)
    edge.frame(0, 5)
    wait_for(lambda: calls(journal) == ["stop", "reset", "stop"], "the robot to be stopped")
    sent = len(edge.frames)
    wait_for(lambda: len(edge.frames) >= sent + 3, "the frame again")
    assert calls(journal) == ["stop", "reset", "stop"]
    for step, action in enumerate((0, 1, 0)):
        edge.act(action, step, 5)
        assert edge.frame(step + 1, 5)[0].applied_action == action
    wait_for(lambda: calls(journal)[3:] == [0, 1, 0, "stop"], "the end of the episode")
    assert robot.counters.get("stops_failed") is None


def test_one_that_is_ended_stops_its_robot(begin: Begin, journal: Path) -> None:
    robot, edge = begin(configured("realtime", 200))
    edge.reset(5)
    edge.frame(3, 5)
    robot.end()
    assert calls(journal)[-1] == "stop"


def test_what_cannot_be_stopped_is_told_and_stopped_again(caplog: pytest.LogCaptureFixture) -> None:
    class Stuck(JournalRobot):
        tries = 0

        def _note(self, call: str, argument: int = -1) -> None:
            del call, argument

        def stop(self) -> None:
            self.tries += 1
            if self.tries < 3:
                raise OSError(5, "no bus", "/dev/ttyUSB0")

    robot, counters = Stuck(TASK), Counters()
    commands = Commands(robot, counters)
    commands.stop()
    assert counters.snapshot() == {"stops_failed": 2}
    assert caplog.text.count("Traceback") == 1  # it is tried again four times a second
    assert "stopping the robot failed: " in caplog.text
    for _ in range(3):
        commands.stop()
    assert robot.tries == 3
    commands.hold()
    commands.stop()
    assert robot.tries == 4


def test_a_robot_that_has_no_stop_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Older(JournalRobot):
        stop = None  # type: ignore[assignment]
        closed = threading.Event()

        def close(self) -> None:
            self.closed.set()

    monkeypatch.setattr("bpn_shared.plugins.load", lambda _group, _name: Older)
    with pytest.raises(
        ConfigError, match=r"robot 'journal' cannot be stopped: give it a method stop\(\)"
    ):
        make_robot(TASK)
    assert Older.closed.is_set()
