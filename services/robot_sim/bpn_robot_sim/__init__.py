"""Simulated robots with cameras: MuJoCo physics, 84x84 images, Gymnasium environments.

Importing this package registers the environments with Gymnasium; it loads neither MuJoCo nor OpenGL.
"""

import gymnasium

from bpn_tasks import factored, specs

ENVIRONMENTS = {
    "reaching": "bpn/Reaching-v0",
    "tracking": "bpn/Tracking-v0",
    "pan_tilt": "bpn/PanTilt-v0",
    "reaching_both": "bpn/ReachingBoth-v0",
    "pan_tilt_both": "bpn/PanTiltBoth-v0",
    "arm": "bpn/Arm-v0",
}
"""Ids of the tasks as environments, by task."""

_TASKS = (
    specs.reaching(), specs.tracking(), specs.pan_tilt(),
    factored.reaching_both(), factored.pan_tilt_both(), factored.arm(),
)  # fmt: skip

EPISODE_STEPS = {task.name: int(task.preset["steps"]) for task in _TASKS}
"""T of each task; of the paper's, as it has it."""

for _name, _steps in EPISODE_STEPS.items():
    if ENVIRONMENTS[_name] not in gymnasium.registry:
        gymnasium.register(
            ENVIRONMENTS[_name],
            entry_point="bpn_robot_sim.env:RobotEnv",
            max_episode_steps=_steps,
            kwargs={"task_name": _name},
        )
