"""Simulated robots with cameras: MuJoCo physics, 84x84 images, Gymnasium environments.

Importing this package registers the environments with Gymnasium; it loads neither MuJoCo nor OpenGL.
"""

import gymnasium

from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.tasks import TASKS

EPISODE_STEPS = {name: RunConfig.for_task(name).steps for name in TASKS}
"""T of each task, as the paper has it."""

for _name, _steps in EPISODE_STEPS.items():
    if TASKS[_name].env_id not in gymnasium.registry:
        gymnasium.register(
            TASKS[_name].env_id,
            entry_point="bpn_robot_sim.env:RobotEnv",
            max_episode_steps=_steps,
            kwargs={"task_name": _name},
        )
