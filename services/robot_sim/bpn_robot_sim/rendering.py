"""A camera of a MuJoCo scene as 84x84 pixels, without a display."""

import os
from typing import Any

import numpy as np

from bpn_robot.frame import Frame
from bpn_robot_sim.opengl import RenderingError, mujoco
from bpn_shared.spec.network import IMAGE_SIZE_PX

__all__ = ["Camera", "RenderingError", "backend"]

_FLAGS_OFF = ("SHADOW", "REFLECTION", "SKYBOX", "HAZE", "FOG")
_MINIMAL_MODEL = (
    "<mujoco><worldbody><geom size='1'/><camera name='any' pos='0 0 9'/></worldbody></mujoco>"
)


class Camera:
    """One named camera of a model. Use it in the thread that made it: OpenGL contexts are per thread.

    Multisampling, shadows, reflections, skybox, haze and fog are off (the model's visual settings are
    changed for that), so that a surface with only emission has exactly its colour in every pixel.

    Args:
        model: the mujoco.MjModel.
        name: the camera's name in the model.
        channels: 3 for RGB; 1 for a scene that is drawn in grays alone (its red plane is the image).
        size_px: rows and columns of its images.

    Raises:
        ValueError: there is no camera of that name, or channels is neither 1 nor 3.
        RenderingError: OpenGL cannot be started.
    """

    def __init__(self, model: Any, name: str, channels: int, size_px: int = IMAGE_SIZE_PX) -> None:
        if channels not in (1, 3):
            raise ValueError(f"channels = {channels} must be 1 (gray) or 3 (RGB)")
        self._camera_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
        if self._camera_id < 0:
            names = ", ".join(model.camera(i).name for i in range(model.ncam))
            raise ValueError(f"camera {name!r} is not in the model; it has: {names or 'none'}")
        self._channels = channels
        model.vis.quality.offsamples = 0
        model.vis.quality.shadowsize = 0
        model.vis.global_.offwidth = model.vis.global_.offheight = size_px
        self._renderer = _start_renderer(model, size_px)
        for flag in _FLAGS_OFF:
            self._renderer.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
        self._rgb = np.empty((size_px, size_px, 3), np.uint8)

    def render(self, data: Any) -> Frame:
        """The scene of `data` (a mujoco.MjData) as a new contiguous uint8[channels, size_px, size_px]."""
        self._renderer.update_scene(data, self._camera_id)
        self._renderer.render(out=self._rgb)
        return np.ascontiguousarray(self._rgb[:, :, : self._channels].transpose(2, 0, 1))

    def close(self) -> None:
        """Frees the OpenGL context; the camera cannot be used afterwards."""
        self._renderer.close()


def backend() -> str:
    """How images are made on this machine, like `egl, llvmpipe (LLVM 15.0.6, 256 bits)`.

    Raises:
        RenderingError: OpenGL cannot be started.
    """
    renderer = _start_renderer(mujoco.MjModel.from_xml_string(_MINIMAL_MODEL))
    try:
        # Here, not above: it binds to the backend that MuJoCo started.
        from OpenGL import GL  # type: ignore[import-untyped]  # noqa: PLC0415

        device = GL.glGetString(GL.GL_RENDERER).decode()
    finally:
        renderer.close()
    return f"{os.environ.get('MUJOCO_GL', 'default')}, {device}"


def _start_renderer(model: Any, size_px: int = IMAGE_SIZE_PX) -> Any:
    try:
        return mujoco.Renderer(model, size_px, size_px)
    except Exception as error:  # each backend fails with exceptions of its own
        raise RenderingError(error) from error
