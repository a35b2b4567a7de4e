"""The edge's end of the protocol: what it records and answers, whatever gets lost between it and its robot."""

from collections.abc import Callable

import numpy as np
import pytest
from learner_side import RUN
from loop_parts import Scene, good

from bpn.verify.draws import step_uniforms
from bpn.verify.play import greedy_choice, softmax_choice
from bpn_shared.bnn import golden
from bpn_shared.bus import keys
from bpn_shared.bus.latest import DirectSubscriber
from bpn_shared.bus.session import Bus
from bpn_shared.messages.action import Action
from bpn_shared.messages.control import Assignment
from bpn_shared.messages.decision import Decision
from bpn_shared.messages.frame import FrameHeader, FrameKind
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import stack

OpenBus = Callable[[], Bus]
STEPS = 12


@pytest.mark.parametrize("algorithm", ["bpn", "bqn"])
def test_an_episode_holds_what_the_policy_saw_said_and_did(
    scene: Callable[..., Scene],
    algorithm: str,
) -> None:
    config = RunConfig.for_task(
        "gym:CartPole-v1",
        algorithm=algorithm,
        actions=5,
        hidden_units=16,
        steps=STEPS,
        frames_stacked=3,
    )
    playing = scene(
        config, lambda header, step: header._replace(reward=step / 4, deadline_misses=step)
    )
    playing.begin()
    learner, blob = playing.learner, playing.blob
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
        numbers = [number for (number,) in step_uniforms(episode.meta.seed, STEPS)]
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


CONFIG = RunConfig.for_task("reaching", hidden_units=16, steps=3)


def test_a_frame_that_comes_again_gets_the_same_action(
    open_bus: OpenBus,
    scene: Callable[..., Scene],
    wait_for: Callable[..., None],
) -> None:
    playing = scene(CONFIG)
    playing.robot.hears = False
    heard: list[Action] = []
    listener = DirectSubscriber(
        open_bus(),
        keys.action(RUN, 0),
        lambda _a, payload, _t: heard.append(Action.decode(payload, CONFIG.task_spec.actions)),
    )
    playing.begin()
    wait_for(lambda: len(heard) >= 4, "four answers to one frame")
    assert len(set(heard)) == 1
    playing.robot.hears = True
    episode = playing.learner.next_delivery()
    assert episode.actions[0] == heard[0].action
    del listener


def test_a_frame_is_answered_before_it_comes_again(
    scene: Callable[..., Scene], wait_for: Callable[..., None]
) -> None:
    sent: list[
        tuple[int, int]
    ] = []  # by the robot, which goes on to the next step with an answer alone

    def note(header: FrameHeader, step: int) -> FrameHeader:
        sent.append((header.reset_id, step))
        return header

    def answered_at_once() -> bool:
        frames = list(sent)
        return any(
            frames.count((episode, step)) == 1 and (episode, step + 1) in frames
            for episode, step in frames
        )

    scene(CONFIG, note).begin()
    wait_for(answered_at_once, "the answer to a frame that was sent once")


def test_who_watches_is_shown_what_was_decided_and_why(
    open_bus: OpenBus,
    scene: Callable[..., Scene],
    wait_for: Callable[..., None],
) -> None:
    playing = scene(CONFIG)
    learner, blob = playing.learner, playing.blob
    shown: list[Decision] = []
    watching = DirectSubscriber(
        open_bus(),
        keys.decision(RUN, 0),
        lambda _a, payload, _t: shown.append(Decision.decode(payload)),
    )
    playing.begin()
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
    scene: Callable[..., Scene],
) -> None:
    playing = scene(CONFIG)
    playing.robot.forgets_at = 2
    service = playing.begin()
    episode = playing.learner.next_delivery()
    assert service.counters["episodes_begun_again"] == 1
    assert episode.frames[:, 0, 0, 0].tolist() == [0, 1, 2, 3]
    assert playing.learner.faults == []


def test_the_next_episode_begins_while_the_learner_writes_the_last_one(
    scene: Callable[..., Scene],
    wait_for: Callable[..., None],
) -> None:
    frames: list[FrameHeader] = []

    def note(header: FrameHeader, _step: int) -> FrameHeader:
        frames.append(header)
        return header

    playing = scene(CONFIG, note)
    learner = playing.learner
    learner.disk.clear()
    playing.begin()
    try:
        wait_for(lambda: sum(h.kind == FrameKind.LAST for h in frames) >= 2, "a second episode")
        assert len({header.reset_id for header in frames}) == 2
        assert learner.delivered == []
        assert [asked.in_hand for asked in learner.asked] == [None, (0, 0)]
    finally:
        learner.disk.set()
    assert learner.next_delivery().steps == 3  # nothing is lost


def test_in_realtime_an_episode_with_a_lost_frame_is_played_again(
    scene: Callable[..., Scene],
    wait_for: Callable[..., None],
) -> None:
    config = RunConfig.for_task("reaching", hidden_units=16, steps=3, pacing="realtime")

    def skip(header: FrameHeader, step: int) -> FrameHeader:
        return header._replace(step=2) if step == 1 else header

    playing = scene(config, skip)
    service = playing.begin()
    wait_for(lambda: service.counters.get("episodes_with_missing_frames", 0) >= 2, "two such")
    playing.robot.bend = good
    assert playing.learner.next_delivery().steps == 3
    assert playing.learner.faults == []


def test_frames_of_another_reset_are_nobodys(
    scene: Callable[..., Scene],
    wait_for: Callable[..., None],
) -> None:
    playing = scene(CONFIG, lambda header, _: header._replace(reset_id=header.reset_id ^ 1))
    service = playing.begin()
    wait_for(lambda: service.counters.get("frames_of_other_episodes", 0) >= 2, "two such")
    playing.robot.bend = good
    assert playing.learner.next_delivery().steps == 3


def test_what_is_in_hand_is_delivered_though_the_robot_does_not_begin_the_next_one(
    scene: Callable[..., Scene],
) -> None:
    playing = scene(CONFIG)
    learner = playing.learner
    assign = learner.assignment

    def assign_when_the_robot_is_gone() -> Assignment:
        if learner.asked[-1].in_hand is not None:
            playing.robot.leave()
        return assign()

    learner.assignment = assign_when_the_robot_is_gone  # type: ignore[method-assign]
    playing.begin()
    assert learner.next_delivery().meta.episode == 0


def test_what_is_in_hand_keeps_no_edge_when_the_run_is_finished(
    scene: Callable[..., Scene], wait_for: Callable[..., None]
) -> None:
    playing = scene(CONFIG)
    learner = playing.learner
    assign = learner.assignment

    def finished_when_played() -> Assignment:
        if learner.asked[-1].in_hand is None:
            return assign()
        return Assignment(status="finished", reason="all iterations are done")

    learner.assignment = finished_when_played  # type: ignore[method-assign]
    learner.disk.clear()
    edge = playing.begin()
    try:
        wait_for(lambda: not edge.alive, "the edge's end")
    finally:
        learner.disk.set()
    assert learner.delivered == []
