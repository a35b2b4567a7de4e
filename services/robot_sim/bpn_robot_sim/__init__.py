"""Simulated robots with cameras: MuJoCo physics, 84x84 images, Gymnasium environments.

Importing this package registers the environments with Gymnasium; it loads neither MuJoCo nor OpenGL.
"""

import gymnasium

from bpn_shared.tasks import TASKS

EPISODE_STEPS = {"reaching": 20}  # T of the paper's Table I

for _name, _steps in EPISODE_STEPS.items():
    if TASKS[_name].env_id not in gymnasium.registry:
        gymnasium.register(
            TASKS[_name].env_id,
            entry_point="bpn_robot_sim.env:RobotEnv",
            max_episode_steps=_steps,
            kwargs={"task_name": _name},
        )
