"""What a policy sees of an environment: every way to say a picture gives the same picture, or a reason."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_robot.robot import RobotFault
from bpn_robot_sim.environment import GymEnvironment
from bpn_robot_sim.gym_robot import GymRobot
from bpn_robot_sim.pictures import ObservedPictures, PictureError, as_frame, brightest, cropped
from bpn_robot_sim.probe import probe_environment
from bpn_shared.messages.probe import ProbeRequest
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.gym import Crop, GymOptions

LEVELS = st.integers(0, 255)
SIZES = st.integers(5, 40)


@st.composite
def pictures(draw: st.DrawFn) -> np.ndarray:
    """Any uint8[height, width, 3]; neither size is a number of channels."""
    height, width = draw(SIZES), draw(SIZES)
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return random.integers(0, 256, (height, width, 3)).astype(np.uint8)


def said_as(kind: str, picture: np.ndarray) -> tuple[Any, Any, str]:
    """Space, observation and key of a picture in one of the ways in which environments say it."""
    levels = Box(0, 255, picture.shape, np.uint8)
    if kind == "channels first":
        moved = picture.transpose(2, 0, 1)
        return Box(0, 255, moved.shape, np.uint8), moved, ""
    if kind == "floats":
        return Box(0, 1, picture.shape, np.float64), picture / 255.0, ""
    if kind == "RGBA":
        four = np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)])
        return Box(0, 255, four.shape, np.uint8), four, ""
    if kind == "key":
        parts = {"image": levels, "direction": Discrete(4)}
        return Dict(parts), {"image": picture, "direction": 2}, "image"
    return levels, picture, ""


KINDS = ("channels last", "channels first", "floats", "RGBA", "key")


@given(st.sampled_from(KINDS), pictures())
def test_every_way_to_say_a_picture_is_the_same_picture(kind: str, picture: np.ndarray) -> None:
    space, observation, key = said_as(kind, picture)
    assert space.contains(observation)
    np.testing.assert_array_equal(ObservedPictures(space, key).picture(observation), picture)


@given(st.integers(0, 254), st.integers(1, 255))
def test_other_ranges_than_levels_and_bits_are_no_pictures(low: int, width: int) -> None:
    high = min(low + width, 255)
    space = Box(low, high, (6, 7), np.uint8)
    if (low, high) in ((0, 1), (0, 255)):
        values = space.sample()
        found = ObservedPictures(space).picture(values)
        np.testing.assert_array_equal(found, values * np.uint8(255 // high))
    else:
        with pytest.raises(PictureError, match=r"levels 0\.\.255: they may be symbols"):
            ObservedPictures(space)


@given(st.sampled_from(("", "depth", "direction")))
def test_a_wrong_key_lists_what_there_is(key: str) -> None:
    space, _, _ = said_as("key", np.zeros((9, 9, 3), np.uint8))
    with pytest.raises(PictureError) as refused:
        ObservedPictures(space, key)
    assert ("Discrete" if key == "direction" else "image") in str(refused.value)


@given(pictures(), st.tuples(*[st.integers(0, 50)] * 2, *[st.integers(1, 50)] * 2))
def test_a_crop_is_that_part_or_is_refused_with_the_size(
    picture: np.ndarray, numbers: tuple[int, int, int, int]
) -> None:
    crop = Crop(*numbers)
    height, width = picture.shape[:2]
    if crop.x + crop.width <= width and crop.y + crop.height <= height:
        part = cropped(picture, crop)
        assert part.shape == (crop.height, crop.width, 3)
        np.testing.assert_array_equal(part[0, 0], picture[crop.y, crop.x])
        np.testing.assert_array_equal(
            part[-1, -1], picture[crop.y + crop.height - 1, crop.x + crop.width - 1]
        )
    else:
        with pytest.raises(RobotFault, match=f"beyond its pictures, which are {width} x {height}"):
            cropped(picture, crop)


@given(pictures(), pictures())
def test_the_brightest_needs_one_shape(one: np.ndarray, other: np.ndarray) -> None:
    if one.shape == other.shape:
        found = brightest([one, other])
        assert ((found >= one) & (found >= other) & ((found == one) | (found == other))).all()
    else:
        with pytest.raises(RobotFault, match="several sizes"):
            brightest([one, other])


class Blinking(gymnasium.Env[Any, Any]):
    """A light that is on in every other step, beside a bar that grows; and a Dict that shows both."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium's own form
    action_space = Discrete(2)

    def __init__(
        self, render_mode: str | None = None, *, kind: str = "key", level: int = 200
    ) -> None:
        self.render_mode, self.kind, self.level = render_mode, kind, level
        self.observation_space = said_as(kind, self.picture(0))[0]

    def picture(self, count: int) -> np.ndarray:
        shown = np.zeros((20, 30, 3), np.uint8)
        shown[:10, :5] = 255 * (count % 2)
        shown[10:, : 2 + count] = (self.level, 60, 20)
        return shown

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed, options=options)
        self.count = 0
        return said_as(self.kind, self.picture(0))[1], {}

    def step(self, action: Any) -> Any:
        self.count += 1
        seen = said_as(self.kind, self.picture(self.count))[1]
        return seen, float(action), self.count >= 24, False, {}

    def render(self) -> Any:
        return self.picture(self.count)[:, ::-1].copy()  # mirrored, to tell it from observations


class Mirrored(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Renders upside down."""

    def render(self) -> Any:
        picture: Any = self.env.render()
        return picture[::-1]


ID = "bpn-seen/Blinking-v0"
gymnasium.register(ID, entry_point=Blinking)


@settings(deadline=None, max_examples=20)
@given(st.sampled_from(KINDS), st.integers(100, 255))
def test_what_gymnasiums_own_checker_accepts_can_be_a_task(kind: str, level: int) -> None:
    check_env(Blinking(kind=kind, level=level), skip_render_check=True)
    kwargs = f'{{"kind": "{kind}", "level": {level}}}'
    key = "image" if kind == "key" else ""
    asked = ProbeRequest(task=f"gym:{ID}", env_kwargs=kwargs, observation_key=key)
    found = probe_environment(asked)
    assert (found.actions, found.seen, found.note) == (2, "observations", "")


def robot(**values: Any) -> GymRobot:
    task = RunConfig.for_task(
        f"gym:{ID}", **{"actions": 2, "frame_channels": 3, **values}
    ).task_spec
    return GymRobot(task)


def frame_of(picture: np.ndarray) -> np.ndarray:
    return as_frame(np.ascontiguousarray(picture), 3)


def test_observations_and_renders_are_told_apart() -> None:
    shown = Blinking().picture(0)
    for values, expected in (
        ({"observation_key": "image"}, shown),
        ({}, shown[:, ::-1]),  # a Dict has no picture of its own without a key
        ({"frames_from": "renders"}, shown[:, ::-1]),
        ({"env_kwargs": '{"kind": "channels first"}'}, shown),
        ({"env_kwargs": '{"kind": "floats"}', "frames_from": "renders"}, shown[:, ::-1]),
        ({"observation_key": "image", "crop": "0,10,6,10"}, shown[10:, :6]),
        (
            {"env_kwargs": '{"level": 90}', "observation_key": "image"},
            Blinking(level=90).picture(0),
        ),
    ):
        np.testing.assert_array_equal(
            robot(**values).reset(0), frame_of(expected), err_msg=str(values)
        )
    with pytest.raises(ConfigError, match="observations are a Dict of direction, image"):
        robot(frames_from="observations")


@given(st.integers(1, 6), st.data())
@settings(deadline=None, max_examples=30)
def test_a_frame_is_the_brightest_of_the_last_ones_of_an_action(
    skip: int, data: st.DataObject
) -> None:
    over = data.draw(st.integers(1, skip))
    playing = robot(observation_key="image", frame_skip=skip, max_over_frames=over)
    playing.reset(0)
    count = 0
    while not playing.terminated:
        playing.command(1)
        playing.settle()
        played = min(skip, 24 - count)
        count += played
        expected = [Blinking().picture(count - back) for back in range(over)]
        if played < skip:  # what was seen before the end came
            expected = expected[: max(1, over - (skip - played))]
        np.testing.assert_array_equal(playing.frame(), frame_of(np.max(expected, axis=0)))
        assert playing.reward() == played


def test_wrappers_are_applied_in_their_order_and_must_be_allowed() -> None:
    here = __name__
    options = GymOptions(env_wrappers=f"{here}:Mirrored", frames_from="renders")
    env = GymEnvironment(f"gym:{ID}", options, {here})
    env.reset(0)
    np.testing.assert_array_equal(env.picture(), Blinking().picture(0)[::-1, ::-1])
    with pytest.raises(ConfigError, match=f"needs the module {here!r}, which is not allowed here"):
        GymEnvironment(f"gym:{ID}", options)
    ours = GymOptions(env_wrappers=f"{here}:Mirrored,{here}:Mirrored", frames_from="renders")
    twice = GymEnvironment(f"gym:{ID}", ours, {here})
    twice.reset(0)
    np.testing.assert_array_equal(twice.picture(), Blinking().picture(0)[:, ::-1])


@pytest.mark.parametrize(
    ("wrappers", "sentence"),
    [
        ("Nothing", "gymnasium.wrappers has no wrapper 'Nothing'"),
        ("TimeLimit", "TimeLimit cannot be made of the environment alone: TypeError"),
        (f"{__name__}:frame_of", "frame_of cannot be made of the environment alone"),
        (f"{__name__}:Mapping", "Mapping cannot be made of the environment alone"),
        (f"{__name__}:str_of", "returned a str, no environment"),
    ],
)
def test_what_is_no_wrapper_is_refused_by_name(wrappers: str, sentence: str) -> None:
    assert Mapping
    with pytest.raises(ConfigError, match=sentence):
        GymEnvironment(f"gym:{ID}", GymOptions(env_wrappers=wrappers), {__name__})


def str_of(env: Any) -> str:
    """No wrapper."""
    return str(env)


class Forgetful(Blinking):
    """Does not do what its seed says."""

    made = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        Forgetful.made += 1
        self.level = 100 + Forgetful.made
        return super().reset(seed=seed, options=options)


gymnasium.register("bpn-seen/Forgetful-v0", entry_point=Forgetful)


def test_runs_that_will_not_repeat_are_said() -> None:
    found = probe_environment(ProbeRequest(task="gym:bpn-seen/Forgetful-v0", frame_channels=3))
    assert "equal seeds and actions gave other pictures, so runs of it do not repeat" in found.note
