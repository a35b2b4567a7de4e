"""Environments of all odd kinds: each is shown as it is meant, or refused by name when the run is created."""

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete
from hypothesis import given
from hypothesis import strategies as st

from bpn_robot.frame import is_flat
from bpn_robot.robot import RobotFault
from bpn_robot_sim.environment import GymEnvironment
from bpn_robot_sim.pictures import (
    ObservedPictures,
    PictureError,
    as_frame,
    rendered,
    why_blind,
)
from bpn_robot_sim.probe import probe_environment
from bpn_robot_sim.robots import robot_for
from bpn_shared.messages.probe import ProbeRequest
from bpn_shared.spec.config import ConfigError, RunConfig

SHAPE = (30, 40, 3)
LEVELS = Box(0, 255, SHAPE, np.uint8)


def picture(step: int) -> np.ndarray:
    """A bright block that moves over a gradient."""
    levels = np.tile(
        np.linspace(0, 200, SHAPE[1]).astype(np.uint8)[None, :, None], (SHAPE[0], 1, 3)
    )
    levels[:, step % 30 : step % 30 + 5] = 255
    return levels


class Odd(gymnasium.Env[Any, Any]):
    """Every test changes one thing of it."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium's own form
    observation_space: Any = Box(-1, 1, (4,), np.float64)
    action_space: Any = Discrete(3)
    render_mode = None

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.given: list[Any] = []
        self.count = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed, options=options)
        self.count = 0
        return self.observe(), {}

    def step(self, action: Any) -> Any:
        self.count += 1
        self.given.append(action)
        return self.observe(), 1.0, False, False, {}

    def observe(self) -> Any:
        return np.zeros(4)

    def render(self) -> Any:
        return picture(self.count)


def odd(**parts: Any) -> str:
    """The name of a task whose environment is `Odd` with these attributes."""
    kind = type("Kind", (Odd,), parts)
    number = len([name for name in gymnasium.registry if name.startswith("bpn-odd/")])
    gymnasium.register(f"bpn-odd/Kind{number}-v0", entry_point=kind, disable_env_checker=True)
    return f"gym:bpn-odd/Kind{number}-v0"


def raising(error: Exception) -> Callable[..., Any]:
    def method(*_args: Any, **_options: Any) -> Any:
        raise error

    return method


def steps(**changes: Any) -> Callable[..., Any]:
    """A `step` that returns this in place of one of its five values."""

    def method(self: Any, action: Any) -> Any:
        names = ("observation", "reward", "terminated", "truncated", "info")
        values = dict(zip(names, Odd.step(self, action), strict=True)) | changes
        return tuple(values.values())

    return method


def late(error: Exception, at: int) -> Callable[..., Any]:
    def method(self: Any, action: Any) -> Any:
        if self.count + 1 == at:
            raise error
        return Odd.step(self, action)

    return method


REFUSED = {
    "constructor": (
        {"__init__": raising(RuntimeError("no licence\nbuy one"))},
        "cannot be made: RuntimeError: buy one$",
    ),
    "reset": ({"reset": raising(OSError("no port"))}, "reset raised OSError: no port"),
    "reset arity": ({"reset": lambda self, **_: self.observe()}, "reset returned a ndarray"),
    "step": ({"step": late(ValueError("bad joint"), 4)}, "step raised ValueError: bad joint"),
    "step arity": (
        {"step": lambda self, action: Odd.step(self, action)[:4]},
        "step returned 4 values, not",
    ),
    "reward list": ({"step": steps(reward=[1.0])}, r"reward \[1.0\] is no number"),
    "reward none": ({"step": steps(reward=None)}, "reward None is no number"),
    "reward nan": ({"step": steps(reward=np.nan)}, "reward nan"),
    "reward inf": ({"step": steps(reward=-np.inf)}, "reward -inf"),
    "render": ({"render": raising(RuntimeError("no GL"))}, "render raised RuntimeError: no GL"),
    "render none": ({"render": lambda _: None}, "render returned a NoneType where a picture"),
    "render list": (
        {"render": lambda self: [picture(self.count)] * 2},
        "render returned a list of 2 where a picture",
    ),
    "render int32": (
        {"render": lambda self: picture(self.count).astype(np.int32)},
        r"int32\[30, 40, 3\] where uint8 or floats in 0..1 are expected",
    ),
    "render float 255": (
        {"render": lambda self: picture(self.count).astype(np.float32)},
        r"float32\[30, 40, 3\] with values in 25..255, where floats are expected in 0..1",
    ),
    "render shape": (
        {"render": lambda self: picture(self.count)[None]},
        r"uint8\[1, 30, 40, 3\] where \[height, width\]",
    ),
    "no metadata": ({"metadata": None}, "cannot be made: InvalidMetadata"),
    "black": (
        {"render": lambda _: np.zeros(SHAPE, np.uint8)},
        "all pixels .* are in 0..0 of 0..255",
    ),
    "still": (
        {"render": lambda _: picture(3)},
        "all its 21 pictures are alike, whatever the actions",
    ),
    "one colour": (
        {"render": lambda self: np.full(SHAPE, 10 * self.count, np.uint8)},
        "each of its pictures has one colour only",
    ),
    "symbols": (
        {
            "observation_space": Box(0, 255, (7, 7, 3), np.uint8),
            "observe": lambda self: (
                (np.arange(147).reshape(7, 7, 3) + self.count).astype(np.uint8) % 11
            ),
        },
        r"all pixels of all its pictures are in \d+..\d of 0..255",
    ),
    "stacked, unseen": (
        {"observation_space": Box(0, 255, (4, 84, 84), np.uint8), "metadata": {"render_modes": []}},
        "neither 1 .* nor 3 .* channels: of a stack of frames give the newest alone",
    ),
    "float range, unseen": (
        {"observation_space": Box(-1, 1, SHAPE, np.float32), "metadata": {"render_modes": []}},
        "neither uint8 nor floats in 0..1",
    ),
    "another dtype": (
        {"observation_space": LEVELS, "observe": lambda self: picture(self.count) / 255.0},
        r"an observation float64\[30, 40, 3\], its space has uint8\[30, 40, 3\]",
    ),
}


@pytest.mark.parametrize(("parts", "sentence"), REFUSED.values(), ids=REFUSED.keys())
def test_what_cannot_be_learned_from_is_refused_in_one_line(
    parts: dict[str, Any], sentence: str
) -> None:
    task = odd(**parts)
    with pytest.raises(ConfigError, match=sentence) as refusal:
        probe_environment(ProbeRequest(task=task))
    assert str(refusal.value).startswith(task)
    assert "\n" not in str(refusal.value)
    with pytest.raises(
        ConfigError, match=sentence
    ):  # a robot looks as whoever creates the run does
        robot_for(RunConfig.for_task(task, actions=3).task_spec)


SEEN: dict[str, dict[str, Any]] = {
    "uint8": {"observation_space": LEVELS, "observe": lambda self: picture(self.count)},
    "float 0..1": {
        "observation_space": Box(0, 1, SHAPE, np.float32),
        "observe": lambda self: (picture(self.count) / 255).astype(np.float32),
    },
    "channels first": {
        "observation_space": Box(0, 255, (3, *SHAPE[:2]), np.uint8),
        "observe": lambda self: picture(self.count).transpose(2, 0, 1),
    },
    "gray": {
        "observation_space": Box(0, 255, SHAPE[:2], np.uint8),
        "observe": lambda self: picture(self.count)[:, :, 0],
    },
    "rendered": {},
    "rendered floats": {"render": lambda self: picture(self.count) / 255.0},
    "rendered RGBA": {
        "render": lambda self: np.dstack([picture(self.count), np.full(SHAPE[:2], 9, np.uint8)])
    },
}


@pytest.mark.parametrize("parts", SEEN.values(), ids=SEEN.keys())
def test_every_kind_of_picture_is_the_same_frame(parts: dict[str, Any]) -> None:
    task = odd(**parts)
    found = probe_environment(ProbeRequest(task=task, frame_channels=3))
    assert (found.seen, found.note) == ("observations" if "observe" in parts else "renders", "")
    env = GymEnvironment(task)
    env.reset(0)
    for count in range(1, 4):
        env.step(0)
        np.testing.assert_array_equal(as_frame(env.picture(), 3), as_frame(picture(count), 3))


@pytest.mark.parametrize(
    "space",
    [
        Box(0, 255, (4, 84, 84), np.uint8),
        Box(0, 255, (84, 84, 4), np.uint8),
        Dict({"screen": Box(0, 255, SHAPE, np.uint8)}),
        Box(-1, 1, SHAPE, np.float32),
    ],
)
def test_rendering_in_place_of_observations_is_said(space: Any) -> None:
    found = probe_environment(ProbeRequest(task=odd(observation_space=space)))
    assert found.seen == "renders"
    assert "the policy sees what it renders" in found.note


@given(st.integers(0, 254), st.integers(1, 255), st.integers(0, 2**32 - 1))
def test_the_range_of_a_space_becomes_the_range_of_levels(low: int, width: int, seed: int) -> None:
    high = min(low + width, 255)
    space = Box(low, high, (5, 6), np.uint8)
    values = np.random.default_rng(seed).integers(low, high + 1, (5, 6)).astype(np.uint8)
    values[0, 0], values[0, 1] = low, high
    found = ObservedPictures(space).picture(values)
    np.testing.assert_array_equal(found, np.rint((values - float(low)) * 255 / (high - low)))
    assert (found[0, 0], found[0, 1]) == (0, 255)


@given(st.sampled_from([np.nan, np.inf, -np.inf, -0.01, 1.01]))
def test_one_value_outside_is_enough_to_be_refused(value: float) -> None:
    floats = np.full((4, 4), 0.5)
    floats[2, 3] = value
    with pytest.raises(PictureError, match=r"floats are expected in 0\.\.1"):
        rendered(floats)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 3]))
def test_flat_is_one_colour_everywhere(seed: int, channels: int) -> None:
    random = np.random.default_rng(seed)
    frame = np.broadcast_to(random.integers(0, 256, (channels, 1, 1)), (channels, 84, 84)).astype(
        np.uint8
    )
    assert is_flat(frame)
    frame[tuple(random.integers(frame.shape))] ^= 1
    assert not is_flat(frame)


def test_pictures_that_differ_in_one_pixel_are_enough() -> None:
    frames = [as_frame(picture(0), 1)] * 5
    assert why_blind(frames) is not None
    changed = frames[0].copy()
    changed[0, 83, 83] ^= 1
    assert why_blind([*frames, changed]) is None


@given(st.integers(2, 5))
def test_pictures_that_never_change_are_blind_and_one_alone_is_not(count: int) -> None:
    seen = np.zeros((1, 84, 84), np.uint8)
    seen[0, :40] = 255
    assert f"all its {count} pictures are alike" in (why_blind([seen] * count) or "")
    assert why_blind([seen]) is None


def test_an_episode_that_ends_at_once_is_begun_anew_by_the_probe() -> None:
    begun = []

    def reset(self: Any, *, seed: int | None = None, options: Any = None) -> Any:
        begun.append(seed)
        return Odd.reset(self, seed=seed, options=options)

    task = odd(
        step=steps(terminated=True),
        reset=reset,
        render=lambda self: picture(len(begun) + self.count),
    )
    probe_environment(ProbeRequest(task=task, steps=5))
    assert begun == [0, 1, 2, 3, 4, 5]


def test_actions_are_of_the_spaces_own_type() -> None:
    space = Discrete(3, start=-1)
    env = GymEnvironment(odd(action_space=space))
    env.reset(0)
    for action in range(3):
        env.step(action)
    given = env._env.unwrapped.given  # type: ignore[attr-defined]
    assert given == [-1, 0, 1]
    assert all(space.contains(action) and isinstance(action, np.int64) for action in given)


@pytest.mark.parametrize(
    ("info", "success"),
    [
        ({}, None),
        ({"is_success": True}, True),
        ({"is_success": np.bool_(False)}, False),
        ({"success": 1.0}, True),
        ({"is_success": np.array([0.0])}, False),
        ({"is_success": None}, None),
        (None, None),
    ],
)
def test_success_is_what_info_says(info: Any, success: bool | None) -> None:
    env = GymEnvironment(odd(step=steps(info=info)))
    env.reset(0)
    assert env.step(0).success is success


def test_a_step_that_raises_later_is_a_fault_of_the_episode() -> None:
    env = GymEnvironment(odd(step=late(ValueError("bad joint"), 25)))
    env.reset(0)
    for _ in range(24):
        env.step(1)
    with pytest.raises(RobotFault, match="step raised ValueError: bad joint"):
        env.step(1)


DRAWS_UNLESS_TOLD_THAT_NOBODY_LOOKS = """
import os
import gymnasium, numpy as np
class Racer(gymnasium.Env):
    metadata = {"render_modes": ["rgb_array"]}
    observation_space = gymnasium.spaces.Box(-1, 1, (4,), np.float64)
    action_space = gymnasium.spaces.Discrete(3)
    def __init__(self, render_mode=None):
        self.render_mode, self.x = render_mode, 0
        self.draws = os.environ.get("SDL_VIDEODRIVER") != "dummy"
    def reset(self, *, seed=None, options=None):
        return np.zeros(4), {}
    def step(self, action):
        self.x = (self.x + 1) % 30
        return np.zeros(4), 1.0, False, False, {}
    def render(self):
        picture = np.zeros((30, 40, 3), np.uint8)
        picture[:, self.x : self.x + 5] = 255 if self.draws else 0
        return picture
gymnasium.register("Racer-v0", entry_point=Racer)
from bpn_robot_sim.probe import probe_environment
from bpn_shared.messages.probe import ProbeRequest
print(probe_environment(ProbeRequest(task="gym:Racer-v0", frame_channels=1)).actions)
"""


@pytest.mark.parametrize("driver", [None, "dummy"])
def test_environments_that_draw_only_where_somebody_looks_do_draw(driver: str | None) -> None:
    """As some take SDL's `dummy` driver for a word that nobody does; by hand it can be chosen, and is refused."""
    given = {key: value for key, value in os.environ.items() if key != "SDL_VIDEODRIVER"}
    if driver is not None:
        given["SDL_VIDEODRIVER"] = driver
    done = subprocess.run(
        [sys.executable, "-c", DRAWS_UNLESS_TOLD_THAT_NOBODY_LOOKS],
        capture_output=True, text=True, env=given, check=False,
    )  # fmt: skip
    assert (done.stdout == "3\n") == (driver is None)
    assert ("shows nothing to learn from" in done.stderr) == (driver == "dummy")


def test_what_an_environment_prints_goes_to_standard_error(
    capfd: pytest.CaptureFixture[str],
) -> None:
    def init(self: Any, render_mode: str | None = None) -> None:
        print("hello from the constructor")
        Odd.__init__(self, render_mode)

    probe_environment(ProbeRequest(task=odd(__init__=init)))
    said = capfd.readouterr()
    assert (said.out, "hello" in said.err) == ("", True)
