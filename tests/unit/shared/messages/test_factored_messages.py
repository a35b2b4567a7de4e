"""What actions of several dimensions are on the wire and at rest, and that of one dimension nothing changed."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.messages.action import Action
from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.spec.config import RunConfig

ARM = RunConfig.for_task("arm").task_spec
REACHING = RunConfig.for_task("reaching").task_spec


@given(st.integers(0, 2**64 - 1))
def test_an_action_of_many_dimensions_has_room(number: int) -> None:
    action = Action(number, 1, 2, 3, 4, 5)
    assert Action.decode(action.encode(), 2**64) == action
    with pytest.raises(MessageError, match=rf"action: {number} is outside 0\.\.{number - 1}"):
        Action.decode(action.encode(), number)


def test_actions_of_the_first_schema_are_read() -> None:
    older = struct.pack("<BBxxIIQII", 1, 13, 1, 2, 3, 4, 5)
    assert Action.decode(older, 14) == Action(13, 1, 2, 3, 4, 5)
    with pytest.raises(OtherVersionError, match="schema 3, this program reads 1 and 2"):
        Action.decode(b"\3" + older[1:], 14)
    with pytest.raises(MessageError, match="27 bytes, expected 28"):
        Action.decode(older[:-1], 14)
    with pytest.raises(MessageError, match="0 bytes"):
        Action.decode(b"", 14)


def episode(actions: np.ndarray, outputs: int) -> Episode:
    steps = len(actions)
    return Episode(
        meta=EpisodeMeta(
            iteration=0, episode=0, seed=0, slot=0, worker="edge-1", weights_attempt=0, weights_version=0,
            terminated=False, deadline_misses=0, duration_ns=1,
        ),
        frames=np.zeros((steps + 1, 1, 84, 84), np.uint8),
        actions=actions.astype(np.uint8),
        rewards=np.zeros(steps),
        outputs=np.zeros((steps, outputs), np.int32),
        inference_ns=np.zeros(steps, np.uint32),
        camera_to_action_ns=np.zeros(steps, np.uint32),
    )  # fmt: skip


@given(st.lists(st.tuples(*[st.integers(0, 6)] * 4), min_size=1, max_size=5))
def test_an_episode_has_the_choice_in_each_dimension(actions: list[tuple[int, ...]]) -> None:
    stored = episode(np.array(actions), ARM.actions).encode()
    assert Episode.decode(stored, ARM).actions.tolist() == [list(action) for action in actions]


def test_a_choice_that_a_dimension_has_not_is_refused() -> None:
    stored = episode(np.array([[0, 0, 7, 0]]), ARM.actions).encode()
    with pytest.raises(MessageError, match=r"action 7 of dimension 2 is outside 0\.\.6"):
        Episode.decode(stored, ARM)
    with pytest.raises(MessageError, match="actions: 4 bytes"):
        Episode.decode(stored, REACHING)
    with pytest.raises(MessageError, match=r"action 14 is outside 0\.\.13"):
        Episode.decode(episode(np.array([14]), 14).encode(), REACHING)
