"""The paper's tasks as published runs had them: older run folders tell a task by its name alone."""

import hashlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from paper import TASKS

from bpn_shared.spec.installed import offered
from bpn_shared.spec.tasks import TaskOptions, TaskSpec
from bpn_tasks import gym

LEARNED = {"frame_channels", "frames_stacked", "frame_skip", "action_names", "hold_action",
           "control_period_s", "success_reward"}  # fmt: skip


def digest(spec: TaskSpec) -> str:
    values = [getattr(spec, name) for name in sorted(LEARNED)]
    return hashlib.sha256(repr(values).encode()).hexdigest()[:16]


@pytest.mark.parametrize(("task", "expected"), [
    ("reaching", "11d244091aaa5097"), ("tracking", "e8463dc017e4e115"), ("pan_tilt", "16f19371e9d06ca0"),
])  # fmt: skip
def test_what_a_task_is_never_changes(task: str, expected: str) -> None:
    """A folder of before 0.2 gets this specification: another one would be another task."""
    assert digest(TASKS[task]) == expected


def test_a_gym_task_is_what_its_options_say() -> None:
    spec = gym.spec("gym:space/Some-v3", TaskOptions(actions=5, frame_channels=3))
    assert (spec.actions, spec.frame_shape, spec.frames_stacked) == (5, (3, 84, 84), 2)
    assert (spec.robot, spec.rewards, spec.realtime, spec.success) == ("gym", None, False, "told")


def test_specifications_need_neither_rewards_nor_robots() -> None:
    """They are looked up where a run is created, as by the dashboard, which has neither OpenCV nor MuJoCo."""
    program = (
        "import sys; from bpn_shared.spec.installed import offered; offered()\n"
        "print(*sorted({'cv2', 'mujoco', 'gymnasium', 'torch'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == ""


def test_rewards_need_no_robot() -> None:
    program = (
        "import sys; from bpn_shared.spec.installed import offered\n"
        "from bpn_shared.spec.rewards import reward_function\n"
        "for task in offered().specs: reward_function(task)\n"
        "print(*sorted({'mujoco', 'gymnasium', 'torch'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == ""


def test_all_that_are_ours_are_offered() -> None:
    assert {*TASKS, "gym:", "gym:CartPole-v1"} <= offered().presets.keys()


def test_no_service_names_a_task() -> None:
    """They know tasks by value alone; names stand in packaging files, and in the plug-ins themselves."""
    root = Path(__file__).parents[3]
    named = re.compile(rf"\b({'|'.join(TASKS)})\b")
    found = [
        path
        for part in ("shared", "services/edge", "services/learner", "services/dashboard", "services/robot")
        for kind in ("py", "ts", "svelte", "cpp")
        for path in (root / part).rglob(f"*.{kind}")
        if "node_modules" not in path.parts
        and named.search(path.read_text(errors="replace"))
    ]  # fmt: skip
    assert found == []
