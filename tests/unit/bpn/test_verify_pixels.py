"""bpn verify and rewards: pictures of a real camera are judged as the task judges them."""

import numpy as np
import pytest
from played import CONFIG, episode

from bpn.verify.pixels import PixelError, rewards_of
from bpn_shared.spec.config import RunConfig
from bpn_tasks.markers import TRACKING_TARGET
from bpn_tasks.rewards import reaching_rewards, tracking


def test_a_real_cameras_disc_is_judged_by_the_tasks_own_rewards() -> None:
    task = RunConfig.for_task("tracking").task_spec
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:84, :84]
    frames = np.full((3, 3, 84, 84), 90.0)
    for t, frame in enumerate(frames):
        inside = (x - 30 - 5 * t) ** 2 + (y - 40) ** 2 <= TRACKING_TARGET.radius_px**2
        frame[:, inside] = np.array(TRACKING_TARGET.rgb)[:, None]
    seen = np.clip(np.rint(frames + rng.normal(0, 6, frames.shape)), 0, 255).astype(np.uint8)
    np.testing.assert_array_equal(rewards_of(task, seen), tracking(seen, task))


def test_a_simulated_hand_is_judged_by_its_exact_pixels() -> None:
    frames = episode(0, 0, steps=4).frames
    assert rewards_of(CONFIG.task_spec, frames) == pytest.approx(reaching_rewards(frames))


def test_pictures_without_markers_are_told() -> None:
    with pytest.raises(PixelError, match="frame 0 shows no"):
        rewards_of(CONFIG.task_spec, episode(0, 0, black=True).frames)
