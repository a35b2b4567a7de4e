"""The one door to MuJoCo: chooses how OpenGL is reached without a display, then imports `mujoco`.

MuJoCo binds to the backend that MUJOCO_GL names when it is first imported, so every module here gets it
with `from bpn_robot_sim.opengl import mujoco`. A MUJOCO_GL that is already set is respected.
"""

import ctypes
import os
import sys

_DISABLED = "disabled"
_EGL_PLATFORM_DEVICE = 0x313F
_MAX_DEVICES = 16


class RenderingError(RuntimeError):
    """OpenGL cannot render here; the message says what to install or to set."""

    def __init__(self, cause: Exception) -> None:
        super().__init__(
            f"OpenGL cannot render without a display (MUJOCO_GL={os.environ.get('MUJOCO_GL')!r}: "
            f"{cause}). On Debian or Ubuntu install EGL (apt-get install libegl1 libegl-mesa0 "
            "libgl1-mesa-dri) or OSMesa (apt-get install libosmesa6), leave MUJOCO_GL unset, and "
            "import bpn_robot_sim's modules before mujoco"
        )


def _egl_works() -> bool:
    """Whether some EGL device can be initialized; libEGL alone, without a driver, cannot render."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    address = egl.eglGetProcAddress
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    query_devices, get_display = (
        address(b"eglQueryDevicesEXT"),
        address(b"eglGetPlatformDisplayEXT"),
    )
    if not query_devices or not get_display:
        return False
    devices, count = (ctypes.c_void_p * _MAX_DEVICES)(), ctypes.c_int(0)
    ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(query_devices)(
        _MAX_DEVICES, devices, ctypes.byref(count)
    )
    display_of = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(
        get_display
    )
    initialize = egl.eglInitialize
    initialize.restype = ctypes.c_uint
    initialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    displays = (display_of(_EGL_PLATFORM_DEVICE, device, None) for device in devices[: count.value])
    return any(display and initialize(display, None, None) for display in displays)


def _osmesa_works() -> bool:
    for name in ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


def _choose_backend() -> str | None:
    """EGL, else OSMesa, else none, on Linux; None where MuJoCo's own choice is right."""
    if sys.platform != "linux" or "mujoco" in sys.modules:
        return None
    if _egl_works():
        return "egl"
    return "osmesa" if _osmesa_works() else _DISABLED


# Mesa's software renderer without worker threads: images this small are done before a thread wakes up.
os.environ.setdefault("LP_NUM_THREADS", "0")
if "MUJOCO_GL" not in os.environ and (_chosen := _choose_backend()) is not None:
    os.environ["MUJOCO_GL"] = _chosen

try:
    import mujoco
except Exception as error:  # a backend named by MUJOCO_GL whose library is missing, in many forms
    raise RenderingError(error) from error

__all__ = ["RenderingError", "mujoco"]
