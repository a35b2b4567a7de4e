"""Episodes that cannot be had: the learner is told why, and edge and robot live on."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from learner_side import RUN, LearnerSide
from loop_parts import Headers, Running, Scene, good

from bpn.evaluation.host import EVALUATION, TrialHost
from bpn_edge import memory as edge_memory
from bpn_edge import service as edge
from bpn_edge.kernel.native import NativeKernel
from bpn_robot_sim import worker as robot_sim
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bus.session import Bus
from bpn_shared.messages.frame import FrameKind
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import episode_seed

REACHING = RunConfig.for_task("reaching", hidden_units=16, steps=3)
OpenBus = Callable[[], Bus]


def at(wanted: int, **changes: Any) -> Headers:
    return lambda header, step: header._replace(**changes) if step == wanted else header


GYM = RunConfig.for_task("gym:CartPole-v1", actions=2, hidden_units=16, steps=3, frames_stacked=1)
EVIL = {
    "zero": (REACHING, at(0, kind=FrameKind.LAST), "frame 0 of the robot is LAST"),
    "first again": (REACHING, at(2, kind=FrameKind.FIRST), "frame 2 of the robot is FIRST"),
    "badaction": (
        REACHING,
        at(1, applied_action=200),
        r"frame 1 of the robot tells of action 200, the task has 0\.\.13",
    ),
    "another action": (
        REACHING,
        lambda header, step: (
            header._replace(applied_action=(header.applied_action + 1) % 14)
            if step == 2
            else header
        ),
        r"frame 2 of the robot tells of action \d+, it was given \d+",
    ),
    "no action": (
        REACHING,
        at(1, applied_action=255),
        r"frame 1 of the robot tells of action 255, the task has 0\.\.13",
    ),
    "another episode": (REACHING, at(1, episode=9), r"frame 1 of the robot is of episode \(0, 9\)"),
    "another iteration": (
        REACHING,
        at(0, iteration=9),
        r"frame 0 of the robot is of episode \(9, 0\)",
    ),
    "a step left out": (REACHING, at(1, step=2), "the robot sends frame 2 where frame 1 is due"),
    "the end of an old step": (
        REACHING,
        at(1, step=0, kind=FrameKind.TERMINATED),
        "frame 0 of the robot is TERMINATED",
    ),
    "no reward": (GYM, at(2, reward=np.nan), "frame 2 of the robot tells of a reward of nan"),
}


@pytest.mark.parametrize(("config", "bend", "reason"), EVIL.values(), ids=EVIL.keys())
def test_frames_that_no_robot_sends_are_faults_and_the_edge_lives(
    scene: Callable[..., Scene],
    config: RunConfig,
    bend: Headers,
    reason: str,
) -> None:
    playing = scene(config, bend)
    learner, service = playing.learner, playing.begin()
    reasons = learner.wait_faults(3)
    assert len(set(reasons)) == 1, "what is the same each time is told in the same words"
    assert re.fullmatch(reason, reasons[0])
    assert learner.faults[0].worker == "edge-1"
    assert service.counters["frames_refused"] >= 3
    assert learner.delivered == []
    playing.robot.bend = good
    episode = learner.next_delivery()
    assert episode.steps == 3


class Trap(gymnasium.Env[Any, Any]):
    """Walks; what happens at the fourth step of an episode is the test's."""

    observation_space = Box(0, 255, (20, 30), np.uint8)
    action_space = Discrete(2)
    trap: Callable[[], float] | None = None

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed, options=options)
        self.count = 0
        return self._picture(), {}

    def step(self, action: Any) -> Any:
        del action
        self.count += 1
        trap = type(self).trap
        reward = trap() if trap is not None and self.count == 4 else 1.0
        return self._picture(), reward, False, False, {"is_success": self.count > 4}

    def _picture(self) -> Any:
        picture = np.zeros((20, 30), np.uint8)
        picture[:, self.count % 30] = 255
        return picture


gymnasium.register("bpn-test/Trap-v0", entry_point=Trap, disable_env_checker=True)
TRAP = RunConfig.for_task("gym:bpn-test/Trap-v0", actions=2, hidden_units=16, steps=6)


@pytest.fixture
def waiting_robot(
    running: Callable[..., Running], wait_for: Callable[..., None]
) -> Callable[[], Running]:
    """A robot with a trap, whose look at its environment is over."""

    def start() -> Running:
        robot = running("robot_sim", robot_sim.serve, TRAP)
        wait_for(lambda: robot.worker.waiting.snapshot()[0], "the robot to wait")
        return robot

    return start


@pytest.fixture
def trapped(open_bus: OpenBus, waiting_robot: Callable[[], Running]) -> tuple[LearnerSide, Running]:
    """A learner with weights, and such a robot."""
    learner = LearnerSide(open_bus(), TRAP)
    learner.publish(1, 7)
    return learner, waiting_robot()


def raises() -> float:
    raise ValueError("bad joint\nthe last line")


@pytest.mark.parametrize(
    ("trap", "told"),
    [
        (raises, "step raised ValueError: the last line at step 4"),
        (lambda: float("nan"), "reward nan at step 4"),
        (lambda: float("-inf"), "reward -inf at step 4"),
    ],
)
def test_what_an_environment_does_is_told_by_the_robot_which_lives(
    trapped: tuple[LearnerSide, Running],
    running: Callable[..., Running],
    monkeypatch: pytest.MonkeyPatch,
    trap: Callable[[], float],
    told: str,
) -> None:
    learner, robot = trapped
    monkeypatch.setattr(Trap, "trap", staticmethod(trap))
    service = running("edge", edge.serve, TRAP)
    reasons = learner.wait_faults(3)
    seed = episode_seed(TRAP.seed, 0, 0)
    assert set(reasons) == {f"gym:bpn-test/Trap-v0: {told} (seed {seed})"}
    assert {fault.worker for fault in learner.faults} == {"robot-sim-1"}
    assert robot.alive
    assert service.alive
    monkeypatch.setattr(Trap, "trap", None)
    episode = learner.next_delivery()
    assert (episode.steps, episode.meta.success, episode.meta.terminated) == (6, True, False)
    np.testing.assert_array_equal(episode.rewards, np.ones(6))


def test_an_episode_without_a_picture_is_warned_of(
    trapped: tuple[LearnerSide, Running],
    running: Callable[..., Running],
    monkeypatch: pytest.MonkeyPatch,
    wait_for: Callable[..., None],
) -> None:
    learner, robot = trapped
    running("edge", edge.serve, TRAP)
    learner.next_delivery()
    assert "episodes_without_a_picture" not in robot.counters
    monkeypatch.setattr(Trap, "_picture", lambda _: np.zeros((20, 30), np.uint8))
    wait_for(lambda: robot.counters.get("episodes_without_a_picture"), "the warning")
    (reason,) = [
        text
        for name, text in robot.worker.counters.reasons().items()
        if name == "episodes_without_a_picture"
    ]
    assert "the camera shows nothing" in reason


def test_faults_that_nobody_hears_do_not_end_the_robot_nor_make_a_storm(
    trapped: tuple[LearnerSide, Running],
    running: Callable[..., Running],
    monkeypatch: pytest.MonkeyPatch,
    wait_for: Callable[..., None],
) -> None:
    learner, robot = trapped
    learner._responders[-1].close()  # as a learner of before there were faults
    monkeypatch.setattr(Trap, "trap", staticmethod(raises))
    running("edge", edge.serve, TRAP)
    wait_for(lambda: robot.counters.get("faults_unanswered", 0) >= 2, "two faults")
    monkeypatch.setattr(Trap, "trap", None)
    learner.next_delivery()


def plays(episode: Any, blob: Any) -> None:
    expected = [golden.forward(blob, frame)[-1] for frame in episode.frames[:-1]]
    np.testing.assert_array_equal(np.stack(expected), episode.outputs)


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How often the verification of a bank fails from now on."""
    left = [0]
    verify = edge_memory.verify

    def sometimes(kernel: Any, weights: Any) -> None:
        if left[0] > 0:
            left[0] -= 1
            raise BlobError("one bit stuck")
        verify(kernel, weights)

    monkeypatch.setattr(edge_memory, "verify", sometimes)
    return left


def test_weights_that_failed_the_verification_once_are_had_again(
    open_bus: OpenBus, running: Callable[..., Running], failing: list[int]
) -> None:
    learner = LearnerSide(open_bus(), REACHING)
    failing[0] = 1
    blob = learner.publish(1, 7)
    running("robot_sim", robot_sim.serve, REACHING)
    service = running("edge", edge.serve, REACHING)
    plays(learner.next_delivery(), blob)
    assert service.counters["weights_failed_verification"] == 1
    assert learner.faults == []


def test_weights_that_fail_it_again_and_again_are_a_fault_with_the_reason(
    open_bus: OpenBus, running: Callable[..., Running], failing: list[int]
) -> None:
    learner = LearnerSide(open_bus(), REACHING)
    failing[0] = 1_000_000
    learner.publish(1, 7)
    service = running("edge", edge.serve, REACHING)
    reasons = learner.wait_faults(3)
    assert set(reasons) == {"weights version 7 failed the verification 3 times: one bit stuck"}
    assert service.worker.waiting.snapshot()[0] == reasons[0]


def test_what_a_damaged_bank_plays_is_no_data_and_the_bank_is_mended(
    open_bus: OpenBus,
    running: Callable[..., Running],
    monkeypatch: pytest.MonkeyPatch,
    wait_for: Callable[..., None],
) -> None:
    banks: list[NativeKernel] = []
    load = NativeKernel.load

    def noted(kernel: NativeKernel, weights: Any) -> None:
        load(kernel, weights)
        banks.append(kernel)

    monkeypatch.setattr(NativeKernel, "load", noted)
    learner = LearnerSide(open_bus(), REACHING)
    blob = learner.publish(1, 7)
    running("robot_sim", robot_sim.serve, REACHING)
    service = running("edge", edge.serve, REACHING)
    plays(learner.next_delivery(), blob)
    run = NativeKernel.run

    def damaged(kernel: NativeKernel, observation: Any) -> Any:
        monkeypatch.setattr(NativeKernel, "run", run)  # once, at some step of an episode
        memory = kernel.network.memory()
        memory[len(memory) // 2 :] ^= 255  # so many bits that outputs are others
        return run(kernel, observation)

    monkeypatch.setattr(NativeKernel, "run", damaged)
    wait_for(lambda: service.counters.get("weights_damaged"), "the flipped bits to be noticed")
    learner.next_delivery()
    for episode in learner.delivered:
        plays(episode, blob)
    assert len(banks) == 2


def test_a_trial_that_cannot_be_played_ends_the_evaluation_with_the_reason(
    open_bus: OpenBus,
    running: Callable[..., Running],
    monkeypatch: pytest.MonkeyPatch,
    waiting_robot: Callable[[], Running],
) -> None:
    blob = replace(WeightBlob.random(TRAP.network, np.random.default_rng(0)), run=RUN)
    host = TrialHost(open_bus(), RUN, TRAP, blob, count=2, policy="greedy")
    waiting_robot()
    monkeypatch.setattr(Trap, "trap", staticmethod(raises))
    running("edge", edge.serve, TRAP)
    assert host.over.wait(30)
    assert host.failure == (
        "trial 0 cannot be played: gym:bpn-test/Trap-v0: step raised ValueError: the last line at step 4 "
        f"(seed {episode_seed(TRAP.seed, EVALUATION, 0)}) (3 times in a row)"
    )
