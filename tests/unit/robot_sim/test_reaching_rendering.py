"""Cameras and the choice of OpenGL; the latter in fresh processes, for it is made once in each."""

import os
import subprocess
import sys

import numpy as np
import pytest

from bpn_robot_sim.opengl import mujoco
from bpn_robot_sim.rendering import Camera, RenderingError, backend

SCENE = """<mujoco>
  <visual><headlight ambient="0 0 0" diffuse="0 0 0" specular="0 0 0"/></visual>
  <asset>
    <texture type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="8" height="48"/>
    <material name="m" rgba="0.2 0.4 0.6 1" emission="1" specular="0"/>
  </asset>
  <worldbody>
    <camera name="top" pos="0 0 2" projection="orthographic" fovy="4"/>
    <geom type="box" pos="-0.5 1 0" size="0.5 0.25 0.1" material="m"/>
  </worldbody>
</mujoco>"""
NO_EGL_DRIVER = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent"}


def test_colours_are_exact_and_the_image_is_upright() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = Camera(model, "top", channels=3)
    image = camera.render(data)
    camera.close()
    expected = np.zeros((3, 84, 84), np.uint8)
    # One metre is 21 px: x from -1 m to 0 m, y from 0.75 m to 1.25 m above the middle.
    expected[:, 16:26, 21:42] = np.array([51, 102, 153], np.uint8)[:, None, None]
    np.testing.assert_array_equal(image, expected)
    assert image.flags.c_contiguous


def test_an_image_has_the_size_that_is_asked_for() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = Camera(model, "top", channels=1, size_px=40)
    image = camera.render(data)
    camera.close()
    expected = np.zeros((1, 40, 40), np.uint8)
    # One metre is 10 px: x from -1 m to 0 m, y from 0.75 m to 1.25 m above the middle, in halves of pixels.
    expected[:, 8:12, 10:20] = 51
    assert image.shape == (1, 40, 40)
    np.testing.assert_array_equal(image[:, 8:12], expected[:, 8:12])


def test_cameras_do_not_disturb_each_other() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    first, second = Camera(model, "top", 1), Camera(model, "top", 3)
    before = first.render(data)
    np.testing.assert_array_equal(second.render(data)[:1], before)
    second.close()
    np.testing.assert_array_equal(first.render(data), before)
    first.close()


def test_bad_cameras_are_refused() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    with pytest.raises(ValueError, match="camera 'side' is not in the model; it has: top"):
        Camera(model, "side", 1)
    with pytest.raises(ValueError, match="channels = 2"):
        Camera(model, "top", 2)


def test_backend_names_what_draws() -> None:
    name, device = backend().split(", ", maxsplit=1)
    assert name == os.environ["MUJOCO_GL"]
    assert device


def run(program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    inherited = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    return subprocess.run(
        [sys.executable, "-c", program],
        env=inherited | environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_registration_needs_neither_mujoco_nor_opengl() -> None:
    program = (
        "import sys, bpn_robot_sim, gymnasium\n"
        "assert 'bpn/Reaching-v0' in gymnasium.registry\n"
        "assert 'mujoco' not in sys.modules and 'OpenGL' not in sys.modules"
    )
    result = run(program, **NO_EGL_DRIVER)
    assert result.returncode == 0, result.stderr


def test_without_an_egl_driver_osmesa_draws_or_the_error_says_what_to_install() -> None:
    result = run("from bpn_robot_sim.rendering import backend; print(backend())", **NO_EGL_DRIVER)
    if result.returncode == 0:
        assert result.stdout.startswith("osmesa, ")
    else:
        assert RenderingError.__name__ in result.stderr
        assert "apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri" in result.stderr


@pytest.mark.parametrize("chosen", ["disabled", "bogus"])
def test_a_backend_that_the_user_chose_is_respected(chosen: str) -> None:
    result = run("from bpn_robot_sim.rendering import backend; backend()", MUJOCO_GL=chosen)
    assert f"RenderingError: OpenGL cannot render without a display (MUJOCO_GL={chosen!r}" in (
        result.stderr
    )
