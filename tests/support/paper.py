"""The paper's three tasks, and rewards, by name."""

import numpy as np
import numpy.typing as npt

from bpn_shared.spec.rewards import Rewards, reward_function
from bpn_shared.spec.tasks import TaskSpec
from bpn_tasks.specs import pan_tilt, reaching, tracking

TASKS: dict[str, TaskSpec] = {task.name: task for task in (reaching(), tracking(), pan_tilt())}


def rewards(task: str, frames: npt.NDArray[np.uint8]) -> Rewards:
    """As the learner computes them."""
    function = reward_function(TASKS[task])
    assert function is not None
    return function(frames, TASKS[task])
