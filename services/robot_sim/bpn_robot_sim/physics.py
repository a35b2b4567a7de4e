"""A MuJoCo model with its state, stepped in whole time steps."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn_robot.robot import RobotFault
from bpn_robot_sim.opengl import mujoco

MAX_SETTLING_S = 5.0


class Physics:
    """One simulation.

    Args:
        mjcf: the model as MJCF text.
        textures: pixels uint8[height, width, 3] for textures that the model declares, by name.

    Attributes:
        model, data: mujoco.MjModel and mujoco.MjData (untyped: MuJoCo has no type information).
    """

    def __init__(
        self, mjcf: str, textures: Mapping[str, npt.NDArray[np.uint8]] | None = None
    ) -> None:
        self.model: Any = mujoco.MjModel.from_xml_string(mjcf)
        for name, pixels in (textures or {}).items():
            start = int(self.model.texture(name).adr[0])
            self.model.tex_data[start : start + pixels.size] = pixels.ravel()
        self.data: Any = mujoco.MjData(self.model)
        self.timestep_s = float(self.model.opt.timestep)
        self._owed_s = 0.0

    def reset(self) -> None:
        """The model's initial state, every part of it."""
        mujoco.mj_resetData(self.model, self.data)
        self._owed_s = 0.0

    def update(self) -> None:
        """Puts bodies and cameras where the joint positions say; a step leaves them one step behind."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def advance(self, seconds: float, drive: Callable[[], None] | None = None) -> None:
        """Steps for that long; what a whole number of steps leaves over is kept for the next call.

        Args:
            seconds: how long.
            drive: called before every time step, to move what moves by itself.

        Raises:
            ValueError: seconds is negative or not finite.
        """
        if not 0.0 <= seconds < float("inf"):
            raise ValueError(f"seconds = {seconds} must be finite and not negative")
        self._owed_s += seconds
        steps = round(self._owed_s / self.timestep_s)
        if steps > 0:
            self._owed_s -= steps * self.timestep_s
            if drive is None:
                mujoco.mj_step(self.model, self.data, nstep=steps)
            else:
                for _ in range(steps):
                    drive()
                    mujoco.mj_step(self.model, self.data)
        self.update()

    def advance_until(self, settled: Callable[[], bool], check_every_steps: int) -> None:
        """Steps until `settled()`, asked first before any step.

        Raises:
            RobotFault: it is not settled after 5 simulated seconds.
        """
        for _ in range(round(MAX_SETTLING_S / (self.timestep_s * check_every_steps))):
            if settled():
                break
            mujoco.mj_step(self.model, self.data, nstep=check_every_steps)
        else:
            raise RobotFault(
                f"the robot did not settle within {MAX_SETTLING_S} simulated seconds: "
                f"joint positions {self.data.qpos}, velocities {self.data.qvel}"
            )
        self.update()
