"""gym: tasks: what the environment says is what the robot shows, and what cannot be a task is refused."""

import sys
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, Text
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from bpn.testing import check_robot
from bpn_robot.robot import Robot
from bpn_robot.robots import make_robot
from bpn_robot_sim.pictures import as_frame
from bpn_robot_sim.probe import probe_environment
from bpn_shared.messages.probe import ProbeRequest
from bpn_shared.spec.config import ConfigError, RunConfig


class Corridor(gymnasium.Env[Any, Any]):
    """Walk right; the picture's brightness is the place. Ends at place 5, and gives up after nine steps."""

    observation_space = Box(0, 255, (20, 30, 3), np.uint8)
    action_space = Discrete(3, start=-1)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.place, self.steps = int(self.np_random.integers(3)), 0
        return self._picture(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.place, self.steps = self.place + int(action), self.steps + 1
        return self._picture(), self.place / 4, self.place >= 5, self.steps >= 9, {}

    def _picture(self) -> Any:
        picture = np.full((20, 30, 3), [10 * self.place + 50, 100, 200], np.uint8)
        picture[15:] = 0
        return picture


class Blind(Corridor):
    observation_space = Box(-1, 1, (4,), np.float32)


class Steered(Corridor):
    action_space = Text(3)  # type: ignore[assignment]


class Crowded(Corridor):
    action_space = Discrete(65)


for name, cls in (
    ("Corridor", Corridor),
    ("Blind", Blind),
    ("Steered", Steered),
    ("Crowded", Crowded),
):
    gymnasium.register(f"bpn-test/{name}-v0", entry_point=cls, disable_env_checker=True)


def actions_of(task: str) -> int:
    return probe_environment(ProbeRequest(task=task)).actions


def make(task: str = "gym:bpn-test/Corridor-v0", **changes: Any) -> Robot:
    values = {"actions": actions_of(task), "frame_channels": 3} | changes
    return make_robot(RunConfig.for_task(task, **values).task_spec)


def step(robot: Robot, action: int) -> int:
    robot.command(action)
    robot.settle()
    return round((int(robot.frame()[0, 0, 0]) - 50) / 10)


def test_actions_rewards_frames_and_ends_are_the_environments() -> None:
    robot = make()
    place = (int(robot.reset(seed=3)[0, 0, 0]) - 50) // 10
    assert robot.frame().shape == (3, 84, 84)
    assert robot.frame()[:, 40, 40].tolist() == [10 * place + 50, 100, 200]
    for action, move in ((0, -1), (1, 0), (2, 1), (2, 1)):
        place += move
        assert step(robot, action) == place
        assert (robot.reward(), robot.terminated, robot.truncated) == (place / 4, False, False)
    while place < 5:
        place += 1
        assert step(robot, 2) == place
    assert robot.terminated
    robot.reset(seed=3)
    assert not robot.terminated
    for index in range(9):
        step(robot, 1)
        assert robot.truncated == (index == 8)
    with pytest.raises(ValueError, match=r"action = 3 is outside 0\.\.2"):
        robot.command(3)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"frame_skip": 2, "max_over_frames": 2},
        {"frame_channels": 1},
        {"frame_px": 33, "conv": "8x4x8"},
    ],
)
def test_it_passes_the_check(changes: dict[str, Any]) -> None:
    check_robot(make(**changes))


def test_frames_have_the_size_that_is_asked_for() -> None:
    robot = make(frame_px=10, conv="5x1x8")
    assert robot.task.frame_shape == robot.reset(seed=3).shape == (3, 10, 10)
    lit, dark = (
        robot.frame()[2, :7],
        robot.frame()[2, 8:],
    )  # its picture is dark from row 15 of 20 on
    assert (lit == 200).all()
    assert (dark == 0).all()


def test_an_action_may_take_several_steps_whose_rewards_add_up() -> None:
    robot = make(frame_skip=2)
    place = (int(robot.reset(seed=3)[0, 0, 0]) - 50) // 10
    assert step(robot, 2) == place + 2
    assert robot.reward() == (place + 1) / 4 + (place + 2) / 4
    while not robot.terminated:
        place = step(robot, 2)
    assert place == 5  # it ends within an action, and goes no further


@given(st.integers(0, 2**64 - 1))
@settings(max_examples=20)
def test_equal_seeds_give_equal_starts(seed: int) -> None:
    robot = make()
    np.testing.assert_array_equal(robot.reset(seed), make().reset(seed))


def test_cartpole_is_rendered_and_paid() -> None:
    robot = make("gym:CartPole-v1", frame_channels=1, frame_skip=1)
    first = robot.reset(seed=0)
    assert (first.dtype, first.shape) == (np.uint8, (1, 84, 84))
    assert first.std() > 5  # something is drawn
    steps = 0
    while not robot.terminated:
        step(robot, 0)
        steps += 1
        assert robot.reward() == 1
    assert 5 < steps < 15  # pushed to one side, a pole falls within about ten steps
    reference = gymnasium.make("CartPole-v1", render_mode="rgb_array")
    reference.reset(seed=0)
    picture = Image.fromarray(np.asarray(reference.render())).convert("L")
    np.testing.assert_array_equal(first[0], picture.resize((84, 84), Image.Resampling.BOX))


@pytest.mark.parametrize("channels", [1, 3])
def test_a_frame_is_the_mean_of_what_each_pixel_covers(channels: int) -> None:
    blocks = np.random.default_rng(0).integers(0, 256, (84, 84, 1), np.uint8)
    picture = np.kron(blocks, np.ones((5, 7, 3), np.uint8))
    frame = as_frame(picture, channels)
    assert frame.shape == (channels, 84, 84)
    for plane in frame:
        np.testing.assert_allclose(plane, blocks[:, :, 0], atol=1)
    np.testing.assert_array_equal(as_frame(picture[:, :, :1], channels), frame)
    np.testing.assert_array_equal(as_frame(picture[:, :, 0], channels), frame)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("gym:bpn-test/Blind-v0", "there is nothing for the policy to see"),
        ("gym:bpn-test/Steered-v0", "Discrete, MultiDiscrete, MultiBinary and Box can be learned"),
        ("gym:bpn-test/Crowded-v0", r"65 actions, a policy has 2\.\.64"),
        ("gym:bpn-test/Nowhere-v0", "cannot be made"),
        ("gym:no.such.module/Thing-v0", "cannot be made"),
    ],
)
def test_what_cannot_be_a_task_is_refused_with_its_reason(task: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        actions_of(task)


def test_a_configuration_of_other_actions_is_refused() -> None:
    with pytest.raises(ConfigError, match="has 3 actions, the run's configuration says 5"):
        make(actions=5)


def test_without_pillow_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    for module in ("gym_robot", "environment", "pictures"):
        monkeypatch.delitem(sys.modules, f"bpn_robot_sim.{module}")
    with pytest.raises(ConfigError, match=r"pip install 'bpn-robot-sim\[gym\]'"):
        actions_of("gym:CartPole-v1")
