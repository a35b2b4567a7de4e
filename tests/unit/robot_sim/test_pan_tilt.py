"""The two pan-tilt units: servos, figure-8, projection, backdrop."""

import hashlib
import subprocess
import sys
from math import hypot, radians, tan

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_robot_sim.pan_tilt import backdrop, geometry, scene
from bpn_robot_sim.pan_tilt.robot import PanTiltRobot
from bpn_robot_sim.physics import Physics
from bpn_shared.spec.markers import PAN_TILT_MARKER
from bpn_shared.spec.tasks import TASKS

TASK = TASKS["pan_tilt"]
seeds = st.integers(0, 2**63 - 1)
Rotation = npt.NDArray[np.float64]


def step(robot: PanTiltRobot, action: int) -> None:
    robot.command(action)
    robot.settle()


def test_actions_are_the_papers_seventeen() -> None:
    labels = (-4, -2, 0, 2, 4)
    expected = {
        pair for n in labels for pair in ((0, n), (n, 0), (-n, n), (n, n))
    }  # the paper prints (n,-n) for the last, which is (-n,n) again
    assert set(geometry.ACTIONS_DEG) == expected
    assert len(geometry.ACTIONS_DEG) == TASK.actions == 17
    assert geometry.ACTIONS_DEG[TASK.hold_action] == (0, 0)


@settings(max_examples=30)
@given(seed=seeds, actions=st.lists(st.integers(0, 16), max_size=40))
def test_commanded_angles_add_up_and_are_reached_within_the_period(
    pan_tilt_robot: PanTiltRobot, seed: int, actions: list[int]
) -> None:
    pan_tilt_robot.reset(seed)
    pan, tilt = 0, 0
    assert pan_tilt_robot.info()["agent_deg"] == (0, 0)
    for action in actions:
        step(pan_tilt_robot, action)
        turn = geometry.ACTIONS_DEG[action]
        pan, tilt = min(max(pan + turn[0], -40), 40), min(max(tilt + turn[1], -30), 30)
        assert pan_tilt_robot.commanded_deg == (pan, tilt)
        assert pan_tilt_robot.info()["agent_deg"] == pytest.approx((pan, tilt), abs=0.1)


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("turn_deg", [-4, 4])
def test_a_turn_settles_within_the_control_period_without_overshoot(
    joint: int, turn_deg: int
) -> None:
    physics = Physics(scene.mjcf())
    physics.data.ctrl[joint] = radians(turn_deg)
    angles_deg = []
    for _ in range(round(TASK.control_period_s / physics.timestep_s)):
        physics.advance(physics.timestep_s)
        assert abs(physics.data.actuator_force[joint]) < scene.STALL_TORQUE_NM
        angles_deg.append(np.degrees(physics.data.qpos[joint]) * np.sign(turn_deg))
    assert max(angles_deg) < 4.01
    assert angles_deg[-1] == pytest.approx(4, abs=0.05)


def test_a_servo_never_exceeds_its_stall_torque() -> None:
    physics = Physics(scene.mjcf())
    physics.data.ctrl[0] = radians(90)
    physics.advance(physics.timestep_s)
    assert physics.data.actuator_force[0] == pytest.approx(4.1)


@settings(max_examples=20)
@given(seed=seeds)
def test_the_target_follows_its_figure_closely(pan_tilt_robot: PanTiltRobot, seed: int) -> None:
    pan_tilt_robot.reset(seed)
    angles = [pan_tilt_robot.info()["target_deg"]]
    for _ in range(80):
        step(pan_tilt_robot, TASK.hold_action)
        angles.append(pan_tilt_robot.info()["target_deg"])
    pans, tilts = np.array(angles).T
    assert np.abs(pans).max() == pytest.approx(25, abs=0.5)
    assert np.abs(tilts).max() == pytest.approx(15, abs=0.5)
    # sin 2wt = 2 sin wt cos wt: (tilt/15)^2 = 4 (pan/25)^2 (1 - (pan/25)^2) on the figure.
    share = (pans / 25) ** 2
    np.testing.assert_allclose((tilts / 15) ** 2, 4 * share * (1 - share), atol=0.12)
    assert angles[-1] == pytest.approx(angles[0], abs=1.0)  # once in 80 steps


@given(seed=seeds)
def test_an_episode_starts_with_the_whole_marker_in_the_frame(
    pan_tilt_robot: PanTiltRobot, seed: int
) -> None:
    frame = pan_tilt_robot.reset(seed)
    shown = (frame == np.array(PAN_TILT_MARKER.rgb)[:, None, None]).all(axis=0)
    rows, columns = np.nonzero(shown)
    assert min(rows.min(), columns.min()) >= 0
    radius_px = np.sqrt(np.count_nonzero(shown) / np.pi)
    assert radius_px == pytest.approx(PAN_TILT_MARKER.radius_px, rel=0.12)
    x, y = pan_tilt_robot.info()["target_px"]
    assert hypot(columns.mean() - x, rows.mean() - y) < 0.5


@given(pan_deg=st.floats(-25, 25), tilt_deg=st.floats(-15, 15))
def test_aiming_puts_the_marker_into_the_middle(pan_deg: float, tilt_deg: float) -> None:
    physics = Physics(scene.mjcf())
    marker_m = geometry.marker_m((pan_deg, tilt_deg))
    physics.data.qpos[:] = np.radians([*geometry.aim_deg(marker_m), pan_deg, tilt_deg])
    physics.update()
    data, camera_id = physics.data, physics.model.camera("eye").id
    np.testing.assert_allclose(data.xpos[physics.model.body("marker").id], marker_m, atol=1e-9)
    image = geometry.to_image(
        data.xpos[physics.model.body("marker").id],
        data.cam_xpos[camera_id],
        data.cam_xmat[camera_id].reshape(3, 3),
    )
    assert image == pytest.approx((41.5, 41.5), abs=1e-6)


def test_the_field_of_view_is_thirty_degrees() -> None:
    edge_m = tan(radians(15))
    right = geometry.to_image(np.array([edge_m, 0, -1.0]), np.zeros(3), np.eye(3))
    assert right == pytest.approx((83.5, 41.5))


def rotation(axis: int, angle_deg: float) -> Rotation:
    """About x (0) or z (2), counterclockwise."""
    matrix = np.eye(3)
    first, second = [index for index in range(3) if index != axis]
    cosine, sine = np.cos(radians(angle_deg)), np.sin(radians(angle_deg))
    matrix[[first, second], [first, second]] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix


@pytest.mark.parametrize("pan_deg", [-40, 40])
@pytest.mark.parametrize("tilt_deg", [-30, 30])
def test_the_backdrop_fills_the_frame_up_to_the_limits(
    pan_tilt_robot: PanTiltRobot, pan_deg: int, tilt_deg: int
) -> None:
    half = tan(radians(15))
    for x, z in ((-half, -half), (-half, half), (half, -half), (half, half)):
        ray = rotation(2, pan_deg) @ rotation(0, tilt_deg) @ np.array([x, 1, z])
        hit_m = ray * scene.BACKDROP_M / ray[1]
        assert ray[1] > 0
        assert abs(hit_m[0]) < scene.BACKDROP_HALF_SIZE_M[0]
        assert abs(hit_m[2]) < scene.BACKDROP_HALF_SIZE_M[1]
    diagonal = geometry.ACTIONS_DEG.index((pan_deg // 10, 4 if tilt_deg > 0 else -4))
    pan_tilt_robot.reset(0)
    for _ in range(10):
        step(pan_tilt_robot, diagonal)
    assert pan_tilt_robot.commanded_deg == (pan_deg, tilt_deg)
    for corner in ((0, 0), (0, 83), (83, 0), (83, 83)):
        assert pan_tilt_robot.frame()[:, *corner].any()  # where nothing is drawn it is black


@given(angles=st.tuples(st.floats(-90, 90), st.floats(-60, 60)), phase_deg=st.floats(0, 360))
def test_beyond_its_limits_the_agent_would_not_see_the_marker(
    angles: tuple[float, float], phase_deg: float
) -> None:
    pan_deg, tilt_deg = angles
    if abs(pan_deg) <= 40 and abs(tilt_deg) <= 30:
        return
    axes = rotation(2, pan_deg) @ rotation(0, tilt_deg)
    right, forward, up = axes.T @ np.array(geometry.marker_m(geometry.target_deg(phase_deg)))
    half = tan(radians(15))
    assert forward <= 0 or abs(right / forward) > half or abs(up / forward) > half


def test_the_backdrop_has_structure_at_several_scales_and_no_marker_blue() -> None:
    pixels = backdrop.pixels()
    size_px = backdrop.SIZE_PX
    assert pixels.shape == (size_px, size_px, 3)
    assert pixels.dtype == np.uint8
    assert pixels[..., 2].max() <= backdrop.MAX_BLUE < PAN_TILT_MARKER.rgb[2]
    gray = pixels.mean(axis=-1)
    for block_px in (4, 16, 64):
        blocks = size_px // block_px
        means = gray.reshape(blocks, block_px, blocks, block_px).mean(axis=(1, 3))
        assert means.std() > 8


def test_a_fresh_process_sees_the_same_frames(pan_tilt_robot: PanTiltRobot) -> None:
    program = (
        "import hashlib; from bpn_robot_sim.pan_tilt.robot import PanTiltRobot\n"
        "robot = PanTiltRobot(); digest = hashlib.sha256(robot.reset(9).tobytes())\n"
        "for action in range(17):\n"
        "    robot.command(action); robot.settle(); digest.update(robot.frame().tobytes())\n"
        "print(digest.hexdigest())"
    )
    fresh = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    frames = [pan_tilt_robot.reset(9).tobytes()]
    for action in range(17):
        step(pan_tilt_robot, action)
        frames.append(pan_tilt_robot.frame().tobytes())
    assert fresh.stdout.strip() == hashlib.sha256(b"".join(frames)).hexdigest()
