"""What the learner measures in the frames is what the simulation knows: under 1.5 px in every task."""

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_learner.reward import rewards
from bpn_robot.robot import Robot
from bpn_robot_sim.pan_tilt import backdrop, geometry, scene
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.rendering import Camera
from bpn_robot_sim.robots import make_robot
from bpn_shared.spec.framing import reward_px
from bpn_shared.spec.markers import PAN_TILT_MARKER, TRACKING_TARGET
from bpn_shared.spec.tasks import TASKS

ERROR_PX = 1.5
COLOURS = {"tracking": TRACKING_TARGET.rgb, "pan_tilt": PAN_TILT_MARKER.rgb}
Frame = npt.NDArray[np.uint8]


@pytest.fixture(scope="module")
def robot_of() -> Iterator[Callable[[str], Robot]]:
    robots: dict[str, Robot] = {}

    def get(name: str) -> Robot:
        if name not in robots:
            robots[name] = make_robot(name)
        return robots[name]

    yield get
    for robot in robots.values():
        robot.close()


def shows_target(task: str, frame: Frame) -> bool:
    return bool((frame == np.array(COLOURS[task])[:, None, None]).all(axis=0).any())


@pytest.mark.parametrize("task", TASKS)
@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**63 - 1),
    actions=st.lists(st.integers(0, 2**16), min_size=1, max_size=25),
    drift=st.integers(0, 2**16),
)
def test_rewards_of_an_episode(
    robot_of: Callable[[str], Robot], task: str, seed: int, actions: list[int], drift: int
) -> None:
    robot = robot_of(task)
    frames, truths = [robot.reset(seed)], []
    for step, number in enumerate(actions):
        robot.command((drift if step % 2 else number) % robot.task.actions)
        robot.settle()
        frames.append(robot.frame())
        truths.append(robot.reward())
        if robot.terminated:
            break
    measured = rewards(task, np.stack(frames))
    if task in COLOURS and not shows_target(task, frames[-1]):
        assert robot.terminated
        assert measured[-1] == pytest.approx(truths[-1], abs=15)  # it jumped over the border
        measured, truths = measured[:-1], truths[:-1]
    np.testing.assert_allclose(measured, truths, atol=ERROR_PX)


@pytest.mark.parametrize("task", COLOURS)
@settings(max_examples=60)
@given(seed=st.integers(0, 2**63 - 1), action=st.integers(0, 16))
def test_a_target_that_is_in_the_frame_is_seen(
    robot_of: Callable[[str], Robot], task: str, seed: int, action: int
) -> None:
    """One action again and again: it crosses the border sooner or later, wherever it started."""
    robot = robot_of(task)
    frame = robot.reset(seed)
    while not robot.terminated:
        assert shows_target(task, frame)
        robot.command(action % robot.task.actions)
        robot.settle()
        frame = robot.frame()


@pytest.fixture(scope="module")
def eye() -> Iterator[tuple[Physics, Camera]]:
    physics = Physics(scene.mjcf(), {"backdrop": backdrop.pixels()})
    camera = Camera(physics.model, "eye", 3)
    yield physics, camera
    camera.close()


@settings(max_examples=300)
@given(
    pan_deg=st.floats(-25, 25),
    tilt_deg=st.floats(-15, 15),
    off_deg=st.tuples(st.floats(-18, 18), st.floats(-18, 18)),
)
def test_pan_tilt_anywhere_in_the_frame_and_across_its_border(
    eye: tuple[Physics, Camera], pan_deg: float, tilt_deg: float, off_deg: tuple[float, float]
) -> None:
    physics, camera = eye
    pan, tilt = geometry.aim_deg(geometry.marker_m((pan_deg, tilt_deg)))
    physics.data.qpos[:] = np.radians([pan + off_deg[0], tilt + off_deg[1], pan_deg, tilt_deg])
    physics.update()
    frame = camera.render(physics.data)
    if not shows_target("pan_tilt", frame):
        return
    model, data = physics.model, physics.data
    camera_id = model.camera("eye").id
    truth = reward_px(
        *geometry.to_image(
            data.xpos[model.body("marker").id],
            data.cam_xpos[camera_id],
            data.cam_xmat[camera_id].reshape(3, 3),
        )
    )
    assert rewards("pan_tilt", np.stack([frame, frame]))[0] == pytest.approx(truth, abs=ERROR_PX)
