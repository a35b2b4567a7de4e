import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from paper import TASKS

from bpn_edge.recorder import EpisodeRecorder
from bpn_shared.messages.control import Assignment
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.messages.frame import NO_ACTION, FrameHeader, FrameKind
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import frame_indices, stack

TASK = TASKS["reaching"]


@given(
    st.lists(st.integers(0, 13), min_size=1, max_size=30),
    st.booleans(),
    st.sampled_from([None, False, True]),
    st.integers(0, 2**32),
)
def test_an_episode_holds_what_was_seen_done_and_computed(
    actions: list[int], terminated: bool, success: bool | None, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    frames = rng.integers(0, 256, (len(actions) + 1, *TASK.frame_shape), dtype=np.uint8)
    outputs = rng.integers(-100, 100, (len(actions), TASK.actions), dtype=np.int32)
    recorder = EpisodeRecorder(TASK)
    for step, frame in enumerate(frames):
        assert recorder.next_step == step
        kind = FrameKind.FIRST if step == 0 else FrameKind.MID
        if step == len(actions):
            kind = FrameKind.TERMINATED if terminated else FrameKind.LAST
        applied = NO_ACTION if step == 0 else actions[step - 1]
        recorder.add_frame(
            FrameHeader(
                kind,
                4,
                2,
                step,
                9,
                0,
                applied,
                step * 10,
                step // 2,
                reward=step / 4,
                success=success if step == len(actions) else None,
            ),
            frame,
            1000 + step,
        )
        np.testing.assert_array_equal(recorder.observation(), frame)
        if step < len(actions):
            recorder.add_outputs(outputs[step], step, edge_ns=step)
    assignment = Assignment(
        status="play", iteration=4, episode=2, seed=5, weights_attempt=1, weights_version=6
    )
    episode = recorder.finish(assignment, slot=3, worker="edge-3", weights_attempt=8)
    np.testing.assert_array_equal(episode.frames, frames)
    np.testing.assert_array_equal(episode.outputs, outputs)
    assert episode.actions.tolist() == actions
    assert episode.rewards.tolist() == [t / 4 for t in range(1, len(actions) + 1)]
    assert episode.camera_to_action_ns.tolist() == [10 * t for t in range(1, len(actions) + 1)]
    assert episode.inference_ns.tolist() == list(range(len(actions)))
    assert episode.meta == EpisodeMeta(
        iteration=4, episode=2, seed=5, slot=3, worker="edge-3", weights_attempt=8, weights_version=6,
        terminated=terminated, success=success, deadline_misses=len(actions) // 2,
        duration_ns=len(actions),
    )  # fmt: skip


@given(
    st.lists(
        st.tuples(*[st.integers(1, 10**6)] * 3, st.booleans()).map(list), min_size=1, max_size=30
    ),
    st.integers(-(10**9), 10**9),
)
def test_the_hops_of_a_step_add_up_to_its_round_trip(hops: list[list[int]], offset_ns: int) -> None:
    """The robot's clock is `offset_ns` behind: whatever it is, what one clock measured stays right."""
    recorder, now_ns, loop_ns = EpisodeRecorder(TASK), 10**12, 0
    pixels = np.zeros(TASK.frame_shape, np.uint8)
    for step, (there_ns, edge_ns, back_ns, in_time) in enumerate(hops):
        header = FrameHeader(FrameKind.MID, 0, 0, step, 9, now_ns - offset_ns, 0, loop_ns)
        recorder.add_frame(header, pixels, now_ns + there_ns)
        recorder.add_outputs(np.zeros(TASK.actions, np.int32), 1, edge_ns)
        loop_ns = (there_ns + edge_ns + back_ns) * in_time
        now_ns += 10**7
    last = FrameHeader(FrameKind.LAST, 0, 0, len(hops), 9, now_ns - offset_ns, 0, loop_ns)
    recorder.add_frame(last, pixels, now_ns)
    us = recorder.latencies_us()
    answered = [hop for hop in hops if hop[3]]
    assert us["edge_us"].tolist() == [edge / 1e3 for _, edge, _, _ in hops]
    assert us["bus_us"].tolist() == [(there + back) / 1e3 for there, _, back, _ in answered]
    assert us["camera_to_action_us"].tolist() == [sum(hop[:3]) / 1e3 for hop in answered]
    assert us["camera_to_edge_us"].tolist() == [(hop[0] + offset_ns) / 1e3 for hop in hops]
    assert us["action_to_robot_us"].tolist() == [(hop[2] - offset_ns) / 1e3 for hop in answered]


@given(st.integers(0, 50), st.integers(1, 6))
def test_an_observation_is_the_last_frames_with_the_first_one_repeated(step: int, n: int) -> None:
    indices = frame_indices(step, n)
    assert len(indices) == n
    assert indices[-1] == step
    assert indices == sorted(indices)
    padded = [0] * n + list(range(step + 1))  # as if the first frame had always been there
    assert indices == padded[-n:]
    frames = [np.full((2, 84, 84), t, np.uint8) for t in range(step + 1)]
    assert stack(frames, step, n)[:, 0, 0].tolist() == [t for t in indices for _ in range(2)]


def test_of_several_dimensions_it_holds_the_choice_in_each() -> None:
    arm = RunConfig.for_task("arm").task_spec
    applied = [NO_ACTION, arm.hold_action, 0, arm.joint_actions - 1]
    recorder = EpisodeRecorder(arm)
    for step, action in enumerate(applied):
        kind = (FrameKind.FIRST, FrameKind.MID, FrameKind.MID, FrameKind.LAST)[step]
        header = FrameHeader(kind, 0, 0, step, 9, 0, action)
        recorder.add_frame(header, np.zeros(arm.frame_shape, np.uint8), step)
        if step < 3:
            recorder.add_outputs(np.zeros(arm.actions, np.int32), 1, 1)
    assignment = Assignment(status="play", seed=5)
    episode = recorder.finish(assignment, slot=0, worker="edge-1", weights_attempt=0)
    assert episode.actions.tolist() == [[3] * 4, [0] * 4, [6] * 4]
    assert Episode.decode(episode.encode(), arm).actions.tolist() == episode.actions.tolist()
