"""The check of robots: ours pass, and each way not to keep to the contract is named in one sentence."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from bars import Bar, spec
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn.testing import check_robot
from bpn_robot.frame import Frame
from bpn_robot.robot import RobotFault, check_action


class Closed(Bar):
    closed = 0

    def close(self) -> None:
        self.closed += 1


@given(st.integers(0, 2**63 - 1), st.integers(0, 40), st.sampled_from([1, 3]), st.booleans())
@settings(max_examples=30)
def test_a_robot_that_keeps_to_the_contract_passes_and_is_closed(
    seed: int, steps: int, channels: int, realtime: bool
) -> None:
    robot = Closed(spec(frame_channels=channels, realtime=realtime))
    check_robot(robot, steps=steps, seed=seed)
    assert robot.closed == 1


def test_a_robot_without_a_clock_is_never_asked_to_advance() -> None:
    class Stepwise(Bar):
        def advance(self, seconds: float) -> None:
            raise NotImplementedError

    check_robot(Stepwise(spec(realtime=False)))


def test_a_robot_whose_actions_are_speeds_passes() -> None:
    check_robot(Wheeled(spec()))


def test_an_episode_that_has_ended_is_not_played_on() -> None:
    class Short(Bar):
        over = False

        @property
        def terminated(self) -> bool:
            return self.over

        def reset(self, seed: int) -> Frame:
            self.over = False
            return super().reset(seed)

        def settle(self) -> None:
            super().settle()
            self.over = True

        def advance(self, seconds: float) -> None:
            if self.over:
                raise RobotFault("it is over")
            super().advance(seconds)

    check_robot(Short(spec()))


class Dreaming(Bar):
    """Moves in another way after every reset."""

    nights = 0

    def reset(self, seed: int) -> Frame:
        self.nights += 1
        return super().reset(seed)

    def settle(self) -> None:
        self.at_px = self.goal_px + 1 + self.nights % 4


class Forgetful(Bar):
    """What was commanded before the reset is done after it."""

    left_px = 0.0

    def reset(self, seed: int) -> Frame:
        self.left_px = self.goal_px - self.at_px
        return super().reset(seed)

    def settle(self) -> None:
        self.at_px, self.left_px = self.goal_px + self.left_px, 0.0


class Shared(Bar):
    """Always the same array."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.pixels = super().frame()

    def frame(self) -> Frame:
        self.pixels[:] = super().frame()
        return self.pixels


class Hasty(Bar):
    def command(self, action: int) -> None:
        super().command(action)
        self.at_px = self.goal_px


class Ticking(Bar):
    """Time goes on by itself when its camera is read."""

    def frame(self) -> Frame:
        self.advance(0.01)
        return super().frame()


class Drifting(Bar):
    """Without a command it goes on to the right."""

    commanded = False

    def reset(self, seed: int) -> Frame:
        self.commanded = False
        return super().reset(seed)

    def command(self, action: int) -> None:
        super().command(action)
        self.commanded = True

    def settle(self) -> None:
        super().settle()
        self.commanded = False

    def advance(self, seconds: float) -> None:
        super().advance(seconds)
        self.at_px += 0 if self.commanded else 50 * seconds
        self.commanded = False


class Wheeled(Bar):
    """Its actions are speeds, as a base's are."""

    speed_px_s = 0.0

    def reset(self, seed: int) -> Frame:
        self.speed_px_s = 0.0
        return super().reset(seed)

    def command(self, action: int) -> None:
        super().command(action)
        self.speed_px_s = 2 * (self.goal_px - self.at_px)

    def settle(self) -> None:
        self.advance(self.task.control_period_s)
        self.stop()

    def advance(self, seconds: float) -> None:
        self.at_px += self.speed_px_s * seconds

    def stop(self) -> None:
        self.speed_px_s = 0.0


class Runaway(Wheeled):
    """Cannot be stopped while it moves."""

    def settle(self) -> None:
        super().settle()
        self.speed_px_s = 0.0

    def stop(self) -> None:
        """Does nothing."""


class Homing(Bar):
    """Goes home when it is stopped."""

    def stop(self) -> None:
        self.at_px = self.goal_px = 42.0


class Undecided(Bar):
    """Terminated only until somebody has looked."""

    looked = 0

    def frame(self) -> Frame:
        self.looked += 1
        return super().frame()

    @property
    def terminated(self) -> bool:
        return self.looked > 9 and self.looked % 2 == 0


class Over(Bar):
    terminated: ClassVar[bool] = True  # type: ignore[assignment]


def made(**changes: Any) -> Callable[[], Any]:
    """A robot with other attributes or methods."""
    return lambda: type("Other", (Bar,), changes)(spec())


def test_a_real_cameras_noise_passes_where_that_is_said() -> None:
    noise = np.random.default_rng(0)

    class Noisy(Bar):
        def frame(self) -> Frame:
            return super().frame() ^ noise.integers(4, size=self.task.frame_shape, dtype=np.uint8)

    check_robot(Noisy(spec()), repeatable=False)
    with pytest.raises(AssertionError, match="is not the frame that reset returned"):
        check_robot(Noisy(spec()))


def raises(error: Exception) -> Callable[..., Any]:
    def method(*_args: Any) -> Any:
        raise error

    return method


def frames(change: Callable[[Frame], Any]) -> Callable[[], Any]:
    """A robot whose frames are changed."""
    return made(frame=lambda self: change(Bar.frame(self)))


@pytest.mark.parametrize(("make", "said"), [
    (SimpleNamespace, "SimpleNamespace: task is None, not the TaskSpec"),
    (lambda: Dreaming(spec()), r"seed 0 and the same actions give another frame at step 1$"),
    (lambda: Forgetful(spec()), r"the same actions give another frame at step 1$"),
    (frames(lambda frame: frame.tolist()), r"reset\(0\) is list, no array"),
    (frames(lambda frame: frame / np.float32(255)), r"reset\(0\) is float32\[1, 84, 84\], not uint8\[1, 84, 84\]"),
    (frames(lambda frame: frame[0]), r"is uint8\[84, 84\], not uint8\[1, 84, 84\]"),
    (frames(lambda frame: np.repeat(frame, 3, 0)), r"is uint8\[3, 84, 84\], not uint8\[1, 84, 84\]"),
    (frames(lambda frame: frame[:, :, ::-1]), "is not contiguous; np.ascontiguousarray"),
    (frames(lambda frame: frame * 0), "has one colour only; the camera shows nothing"),
    (frames(lambda frame: np.full_like(frame, frame.argmax() % 84)), "has one colour only; the camera"),
    (lambda: Shared(spec()), "overwrites the frame before it; each has to be a new array"),
    (made(settle=lambda _: None), r"no action and settle\(\) ever changes its frame"),
    (made(advance=lambda *_: None), r"no action and advance\(0.1\) ever changes its frame"),
    (made(command=lambda *_: None), r"command\(-1\) of the actions 0..2 is accepted, it has to raise ValueError"),
    (made(command=raises(IndexError("tuple index"))), r"\(-1\) .* IndexError: tuple index, not ValueError"),
    (lambda: Hasty(spec()), r"command\(\d\) or frame\(\) lets time pass"),
    (lambda: Ticking(spec()), r"frame\(\) lets time pass; only settle\(\) and advance\(\) do"),
    (lambda: Drifting(spec()), r"hold_action = 2 \('stay'\) does something else than no command at all"),
    (lambda: Bar(spec(hold_action=0)), r"hold_action = 0 \('left'\) does something else than no command"),
    (lambda: Runaway(spec()), r"5 control periods after stop\(\) in motion it still moves \(action 0, 'left'\)"),
    (lambda: Homing(spec()), r"stop\(\) between two steps in lockstep, where it is at rest, changes the frames"),
    (made(stop=raises(RobotFault("the brake is open"))), r"stop\(\) has a fault: the brake is open$"),
    (lambda: Over(spec()), r"it has ended right after reset\(0\)"),
    (lambda: Undecided(spec()), "terminated or truncated changes while no time passes"),
    (made(truncated=None), "truncated is None, not True or False"),
    (made(terminated=lambda _: False), "terminated is <bound method .*, not True or False"),
    (made(success="yes"), "success is 'yes', not True, False or None"),
    (made(reward=lambda _: None), r"reward\(\) is None, not a float"),
    (made(truncated=property(raises(OSError("gone")))), "truncated raises OSError: gone$"),
    (made(info=lambda _: None), r"info\(\) is None, not a dict"),
    (made(info=lambda _: {"bar_px": 3.0}), r"info\(\)\['bar_px'\] is 3.0, not a tuple"),
    (made(close=raises(OSError("busy"))), r"close\(\) raises OSError: busy; a robot that cannot go on raises"),
    (made(settle=raises(KeyError("servo"))), r"settle\(\) raises KeyError: 'servo'; .* raises RobotFault$"),
    (made(settle=raises(RobotFault("servo 2 is hot"))), r"settle\(\) has a fault: servo 2 is hot$"),
    (made(settle=lambda self: self), r"settle\(\) returns <.*, not None"),
    (made(reset=lambda self, seed: Bar.reset(self, seed) // 2), r"frame\(\) right after reset\(0\) is not"),
])  # fmt: skip
def test_each_way_not_to_keep_to_it_is_one_sentence(make: Callable[[], Any], said: str) -> None:
    with pytest.raises(AssertionError, match=said) as caught:
        check_robot(make())
    sentence = str(caught.value)
    assert sentence.startswith(("robot 'bar': ", "SimpleNamespace: "))
    assert "\n" not in sentence


def test_each_choice_of_each_dimension_is_stopped_in_motion() -> None:
    class Sideways(Runaway):
        """The last choice of its first dimension moves it, so the last actions of all do."""

        def command(self, action: int) -> None:
            self.speed_px_s = 20.0 * (self.task.choices(check_action(self.task, action))[0] == 2)

    names = tuple(f"{joint} {choice}" for joint in ("wheel", "light") for choice in range(3))
    task = spec(action_names=names, action_dims=(3, 3), hold_action=0)
    with pytest.raises(
        AssertionError, match=r"it still moves \(action [678], 'wheel 2, light \d'\)"
    ):
        check_robot(Sideways(task))


@pytest.mark.parametrize(("reward", "said"), [
    (lambda _: float(np.random.default_rng().random()), "the same actions give other rewards, or another end"),
    (lambda _: float("nan"), r"reward\(\) is nan, not finite"),
])  # fmt: skip
def test_rewards_that_the_robot_tells_are_looked_at(
    reward: Callable[[Any], float], said: str
) -> None:
    robot = type("Told", (Bar,), {"reward": reward})(spec(rewards=None))
    with pytest.raises(AssertionError, match=said):
        check_robot(robot)
