"""One iteration of environments of five other packages, as a user would start it; what their policies saw."""

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder

SHORT = [
    "--iterations", "1", "--episodes", "2", "--steps", "30", "--epochs", "1", "--hidden-units", "16",
    "--frame-channels", "3", "--json",
]  # fmt: skip

Frames = np.ndarray
"""int[frames, red green blue, 84, 84]."""


class Case(NamedTuple):
    """A task with its options, where its frames come from, and what is in its pictures and where."""

    task: str
    options: list[str]
    seen: str
    shows: Callable[[Frames], bool]


def green(frames: Frames) -> np.ndarray:
    """Where it is much greener than red and blue."""
    return frames[:, 1] > 60 + np.maximum(frames[:, 0], frames[:, 2])


def red(frames: Frames) -> np.ndarray:
    return frames[:, 0] > 60 + np.maximum(frames[:, 1], frames[:, 2])


def blue(frames: Frames) -> np.ndarray:
    return frames[:, 2] > 60 + frames[:, 0]


BROWN = 144, 72, 17
MINIGRID = "gym:minigrid:MiniGrid-Empty-5x5-v0"
CASES = [
    # the goal is at the lower right, the agent begins at the upper left
    Case(
        MINIGRID, [], "renders",
        lambda f: bool(green(f)[:, 55:65, 55:65].all() and red(f)[0, :40, :40].any()),
    ),
    # the agent looks up from the lower end of what it sees
    Case(
        MINIGRID,
        ["--env-wrappers", "minigrid.wrappers:RGBImgPartialObsWrapper", "--observation-key", "image"],
        "observations", lambda f: bool(red(f)[:, 70:, 35:50].any((1, 2)).all()),
    ),
    # a brown field; the paddle at the right is green
    Case(
        "gym:ale_py:ALE/Pong-v5", ["--crop", "0,34,160,160", "--frame-skip", "2", "--max-over-frames", "2"],
        "observations",
        lambda f: bool((np.abs(f[5:, :, 40, 20] - BROWN) < 3).all() and green(f)[-1, :, 70:].any()),
    ),
    # three rows of bricks are in the upper half, nothing above them; the background is black
    Case(
        "gym:minatar.gym:MinAtar/Breakout-v1", [], "renders",
        lambda f: bool((f[0, :, 10:32].min() > 100) and f[0, :, :7].max() == 0),
    ),
    # on a gray road, the car that is steered is green and the others are blue
    Case(
        "gym:highway_env:highway-fast-v0", [], "renders",
        lambda f: bool(green(f)[0].any() and blue(f)[0].any() and (f[0, :, 3, 3] == 100).all()),
    ),
    # the sky is above and blue, the ground below and yellow
    Case(
        "gym:flappy_bird_gymnasium:FlappyBird-v0", [], "renders",
        lambda f: bool((f[0, 2, 20] > f[0, 0, 20]).all() and (f[0, 0, 82] > f[0, 2, 82]).all()),
    ),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: " ".join([case.task, *case.options[:1]]))
def test_one_iteration_is_learned_from_pictures_that_are_right(case: Case, tmp_path: Path) -> None:
    done = subprocess.run(
        [os.environ["BPN_ENVIRONMENTS"], "-m", "bpn", "train", case.task, *case.options, *SHORT,
         "--runs-dir", str(tmp_path)],
        capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    folder = RunFolder.open(tmp_path, json.loads(done.stdout)["run_id"])
    config = folder.config()
    assert (folder.state().state, config.frames_from) == ("finished", case.seen)
    for number in range(2):
        episode = Episode.decode(folder.episode_path(0, number).read_bytes(), config.task_spec)
        assert episode.frames.max() > 200
        assert not (episode.frames == episode.frames[0]).all()
        assert case.shows(episode.frames.astype(int))
