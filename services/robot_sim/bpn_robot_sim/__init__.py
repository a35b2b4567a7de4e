"""Simulated robots with cameras: MuJoCo physics, 84x84 images, Gymnasium environments.

Importing this package registers the environments with Gymnasium; it loads neither MuJoCo nor OpenGL.
"""

import gymnasium

from bpn_tasks import specs

ENVIRONMENTS = {
    "reaching": "bpn/Reaching-v0",
    "tracking": "bpn/Tracking-v0",
    "pan_tilt": "bpn/PanTilt-v0",
}
"""Ids of the paper's tasks as environments, by task."""

EPISODE_STEPS = {
    task.name: int(task.preset["steps"])
    for task in (specs.reaching(), specs.tracking(), specs.pan_tilt())
}
"""T of each task, as the paper has it."""

for _name, _steps in EPISODE_STEPS.items():
    if ENVIRONMENTS[_name] not in gymnasium.registry:
        gymnasium.register(
            ENVIRONMENTS[_name],
            entry_point="bpn_robot_sim.env:RobotEnv",
            max_episode_steps=_steps,
            kwargs={"task_name": _name},
        )
