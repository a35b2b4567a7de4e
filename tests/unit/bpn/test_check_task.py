"""The check of tasks: ours pass, and whatever of one's own does not agree is named in one sentence."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bars import Bar, spec
from installed import install
from paper import TASKS

from bpn.testing import check_task
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.tasks import TaskSpec

REWARDS = (
    "rewards",
    "infinite",
    "too_many",
    "of_the_whole",
    "changes_its_frames",
    "blind",
    "at_random",
    "in_words",
)


@pytest.fixture(autouse=True)
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bar's parts, good and bad, are installed."""
    monkeypatch.syspath_prepend(str(tmp_path))
    install(tmp_path, "bars", {
        "bpn.robots": {"bar": "bars:Bar", "sighted": "bars:Sighted", "lost": "bars:Lost", "other": "bars:other"},
        "bpn.rewards": {"bar": "bars:rewards"} | {name: f"bars:{name}" for name in REWARDS},
        "bpn.plots": {"bar": "bars:rewards"},
    })  # fmt: skip


@pytest.mark.parametrize("name", [*TASKS, "reaching_both", "pan_tilt_both", "arm"])
def test_ours_pass(name: str) -> None:
    check_task(RunConfig.for_task(name).task_spec)


def test_an_environment_of_gymnasium_passes() -> None:
    check_task(RunConfig.for_task("gym:CartPole-v1", actions=2).task_spec)


@pytest.mark.parametrize("changes", [
    {}, {"rewards": None}, {"realtime": False}, {"frame_channels": 3}, {"frames_stacked": 4},
    {"success": "last_reward", "success_reward": -1.0}, {"success": "not_terminated"},
])  # fmt: skip
def test_one_of_ones_own_passes(changes: dict[str, Any]) -> None:
    check_task(spec(**changes))


def as_it_is(**changes: Any) -> Callable[[], TaskSpec]:
    return lambda: spec(**changes)


@pytest.mark.parametrize(("make", "said"), [
    (as_it_is(robot="baar"), "robot 'baar' is not installed here; there are: arm, bar, "),
    (as_it_is(robot="lost"), "robot 'lost' (bars:Lost of bars 1.0) is broken: AttributeError: "),
    (as_it_is(robot="sighted", action_names=("left", "right"), hold_action=0), "no camera: /dev/video9"),
    (as_it_is(robot="other"), "its robot's task is another: control_period_s = 0.2, not 0.1"),
    (as_it_is(action_names=("left", "right", "stay", "far left")), "robot 'bar': command(3) raises IndexError: "),
    (as_it_is(rewards="baar"), "rewards 'baar' is not installed here; there are: at_random, bar, "),
    (as_it_is(rewards="infinite"), "rewards 'infinite' are -inf at step 1 of seed 0, not finite"),
    (as_it_is(rewards="too_many"), "(bars:too_many of bars 1.0) is broken: it returned [7] rewards for 7 frames"),
    (as_it_is(rewards="of_the_whole"), "rewards 'of_the_whole' are another at step 1 where the episode ends"),
    (as_it_is(rewards="at_random"), "rewards 'at_random' of the same 7 frames are others when computed again"),
    (as_it_is(rewards="in_words"), "is broken: it returned what are no numbers: could not convert"),
    (as_it_is(rewards="changes_its_frames"), "is broken: ValueError: assignment destination is read-only"),
    (as_it_is(rewards="blind"), "rewards of 7 frames of its robot: frame 3 of 7 of task 'bars' shows no bar"),
    (as_it_is(plot="baar"), "plot 'baar' is not installed here; there are: bar, pan_tilt"),
    (as_it_is(plot="bar"), "plot 'bar' (bars:rewards of bars 1.0) is broken: it is function, no Plot"),
    (as_it_is(preset={"stepz": 9}), "preset: stepz = 9: unknown; one of: task, "),
    (as_it_is(preset={"steps": 0}), "preset: steps = 0: Input should be greater than or equal to 1"),
    (as_it_is(preset={"steps": 0, "hidden_units": 0}), "greater than or equal to 1; hidden_units = 0"),
    (as_it_is(preset={"task": "bars"}), "preset has task, which its name says already"),
    (as_it_is(preset={"gamma": float("nan")}), "preset has nan, which is not finite"),
    (as_it_is(preset={"frames_stacked": 2}), "frames_stacked = 2: task 'bars' has 1; leave it out"),
    (as_it_is(success="told"), "success = 'told', but its robot 'bar' never says; or else it is 'undefined'"),
])  # fmt: skip
def test_what_does_not_agree_is_one_sentence(make: Callable[[], TaskSpec], said: str) -> None:
    with pytest.raises(AssertionError, match=re.escape(said)) as caught:
        check_task(make(), steps=9, seed=0)
    assert "\n" not in str(caught.value)


def test_a_robot_that_says_what_succeeded_has_success_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Bar, "success", False)
    check_task(spec(success="told"))
