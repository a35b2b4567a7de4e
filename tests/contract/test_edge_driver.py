"""The edge's end of the protocol: what it records and answers, whatever gets lost between it and its robot."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from learner_side import RUN, LearnerSide
from loop_parts import EvilRobot, Running

from bpn.verify.draws import step_uniforms
from bpn.verify.play import greedy_choice, softmax_choice
from bpn_edge import service as edge
from bpn_shared.bnn import golden
from bpn_shared.bus import keys
from bpn_shared.bus.latest import DirectSubscriber
from bpn_shared.bus.session import Bus
from bpn_shared.messages.action import Action
from bpn_shared.messages.decision import Decision
from bpn_shared.messages.frame import FrameHeader
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import stack

OpenBus = Callable[[], Bus]
STEPS = 12


@pytest.fixture
def robots(open_bus: OpenBus) -> Iterator[Callable[..., EvilRobot]]:
    started: list[EvilRobot] = []

    def start(config: RunConfig, bend: Any = lambda header, _: header) -> EvilRobot:
        started.append(EvilRobot(open_bus(), config, bend))
        return started[-1]

    yield start
    for robot in started:
        robot.end()


@pytest.mark.parametrize("algorithm", ["bpn", "bqn"])
def test_an_episode_holds_what_the_policy_saw_said_and_did(
    open_bus: OpenBus,
    running: Callable[..., Running],
    robots: Callable[..., EvilRobot],
    algorithm: str,
) -> None:
    config = RunConfig.for_task(
        "gym:CartPole-v1", algorithm=algorithm, actions=5, nodes=16, steps=STEPS, frames_stacked=3
    )
    learner = LearnerSide(open_bus(), config)
    blob = learner.publish(1, 7)
    robots(config, lambda header, step: header._replace(reward=step / 4, deadline_misses=step))
    running("edge", edge.serve, config)
    actions = set()
    for learner.episode in range(4):
        episode = learner.next_delivery()
        while episode.meta.episode != learner.episode:  # one was under way
            episode = learner.next_delivery()
        assert (episode.steps, episode.meta.weights_attempt) == (STEPS, 1)
        assert (episode.meta.weights_version, episode.meta.deadline_misses) == (7, STEPS)
        assert episode.frames[:, 0, 0, 0].tolist() == list(range(STEPS + 1))
        assert episode.rewards.tolist() == [t / 4 for t in range(1, STEPS + 1)]
        for step, outputs in enumerate(episode.outputs):
            seen = stack(list(episode.frames), step, 3)
            np.testing.assert_array_equal(golden.forward(blob, seen)[-1], outputs)
        numbers = step_uniforms(episode.meta.seed, STEPS)
        for action, outputs, number in zip(
            episode.actions.tolist(), episode.outputs, numbers, strict=True
        ):
            P = blob.scale * outputs.astype(float)
            if algorithm == "bpn":
                assert action in softmax_choice(P, config.beta, number)
            else:
                assert action in greedy_choice(P, config.epsilon(0), number)
        actions |= set(episode.actions.tolist())
    assert len(actions) > 1  # or the test would show little


CONFIG = RunConfig.for_task("reaching", nodes=16, steps=3)


def test_a_frame_that_comes_again_gets_the_same_action(
    open_bus: OpenBus,
    running: Callable[..., Running],
    robots: Callable[..., EvilRobot],
    wait_for: Callable[..., None],
) -> None:
    learner = LearnerSide(open_bus(), CONFIG)
    learner.publish(1, 7)
    heard: list[Action] = []
    listener = DirectSubscriber(
        open_bus(),
        keys.action(RUN, 0),
        lambda _a, payload, _t: heard.append(Action.decode(payload, CONFIG.task_spec.actions)),
    )
    deaf = robots(CONFIG)
    deaf.hears = False
    running("edge", edge.serve, CONFIG)
    wait_for(lambda: len(heard) >= 4, "four answers to one frame")
    assert len(set(heard)) == 1
    deaf.hears = True
    episode = learner.next_delivery()
    assert episode.actions[0] == heard[0].action
    del listener


def test_who_watches_is_shown_what_was_decided_and_why(
    open_bus: OpenBus,
    running: Callable[..., Running],
    robots: Callable[..., EvilRobot],
    wait_for: Callable[..., None],
) -> None:
    learner = LearnerSide(open_bus(), CONFIG)
    blob = learner.publish(1, 7)
    shown: list[Decision] = []
    watching = DirectSubscriber(
        open_bus(),
        keys.decision(RUN, 0),
        lambda _a, payload, _t: shown.append(Decision.decode(payload)),
    )
    robots(CONFIG)
    running("edge", edge.serve, CONFIG)
    wait_for(lambda: len(shown) >= 3, "three decisions")
    episodes = {}
    for decision in shown[:3]:
        while decision.episode not in episodes:
            episode = learner.next_delivery()
            episodes[episode.meta.episode] = episode
        episode = episodes[decision.episode]
        assert decision.iteration == episode.meta.iteration
        assert decision.outputs == episode.outputs[decision.step].tolist()
        assert decision.scale == pytest.approx(blob.scale)
        assert (decision.weights_version, decision.time_ns > 0) == (7, True)
        assert 0 < decision.inference_ns <= decision.edge_ns
    del watching


def test_a_robot_that_begins_again_is_recorded_anew(
    open_bus: OpenBus,
    running: Callable[..., Running],
    robots: Callable[..., EvilRobot],
) -> None:
    learner = LearnerSide(open_bus(), CONFIG)
    learner.publish(1, 7)
    forgetful = robots(CONFIG)
    forgetful.forgets_at = 2
    service = running("edge", edge.serve, CONFIG)
    episode = learner.next_delivery()
    assert service.counters["episodes_begun_again"] == 1
    assert episode.frames[:, 0, 0, 0].tolist() == [0, 1, 2, 3]
    assert learner.faults == []


def test_in_realtime_an_episode_with_a_lost_frame_is_played_again(
    open_bus: OpenBus,
    running: Callable[..., Running],
    robots: Callable[..., EvilRobot],
    wait_for: Callable[..., None],
) -> None:
    config = RunConfig.for_task("reaching", nodes=16, steps=3, pacing="realtime")
    learner = LearnerSide(open_bus(), config)
    learner.publish(1, 7)

    def skip(header: FrameHeader, step: int) -> FrameHeader:
        return header._replace(step=2) if step == 1 else header

    robot = robots(config, skip)
    service = running("edge", edge.serve, config)
    wait_for(lambda: service.counters.get("episodes_with_missing_frames", 0) >= 2, "two such")
    robot.bend = lambda header, _: header
    assert learner.next_delivery().steps == 3
    assert learner.faults == []


def test_frames_of_another_reset_are_nobodys(
    open_bus: OpenBus,
    running: Callable[..., Running],
    robots: Callable[..., EvilRobot],
    wait_for: Callable[..., None],
) -> None:
    learner = LearnerSide(open_bus(), CONFIG)
    learner.publish(1, 7)
    robot = robots(CONFIG, lambda header, _: header._replace(reset_id=header.reset_id ^ 1))
    service = running("edge", edge.serve, CONFIG)
    wait_for(lambda: service.counters.get("frames_of_other_episodes", 0) >= 2, "two such")
    robot.bend = lambda header, _: header
    assert learner.next_delivery().steps == 3
