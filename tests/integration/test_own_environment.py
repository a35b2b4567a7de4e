"""An environment of another package, through all processes: only where its module is allowed."""

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder

Command = Callable[..., list[str]]
Bpn = Callable[..., "subprocess.CompletedProcess[str]"]

PACKAGE = '''
"""A package that nobody here knows: what it does when it is imported is seen in a file."""
import os
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

Path(os.environ["IMPORTED"]).open("a").write(f"{os.getpid()}\\n")


class Light(gymnasium.Env):
    """A bar that grows with every step; its colour is the keyword argument's."""

    observation_space = Dict({"image": Box(0, 255, (3, 84, 168), np.uint8), "speed": Discrete(9)})
    action_space = Box(-1, 1, (1,), np.float32)

    def __init__(self, colour):
        self.colour = colour

    def seen(self):
        image = np.zeros((3, 84, 168), np.uint8)
        image[:, :, : 84 + 2 * self.count] = np.reshape(self.colour, (3, 1, 1))
        return {"image": image, "speed": self.count % 9}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0
        return self.seen(), {}

    def step(self, action):
        self.count += 1
        return self.seen(), float(action[0]), self.count == 12, False, {}


class Dimmed(gymnasium.ObservationWrapper):
    """Half as bright."""

    def observation(self, observation):
        return observation | {"image": observation["image"] // 2}


def register_envs():
    gymnasium.register("Lab/Light-v0", entry_point=Light)
'''
TASK = "gym:lab_pack.lights:Lab/Light-v0"
OPTIONS = [
    TASK, "--iterations", "2", "--episodes", "2", "--epochs", "1", "--hidden-units", "16", "--steps", "9",
    "--frame-channels", "3", "--env-kwargs", '{"colour": [200, 100, 50]}', "--env-wrappers",
    "lab_pack.lights:Dimmed", "--observation-key", "image", "--crop", "84,0,84,84", "--difference",
    "--action-bins", "3",
]  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("place")
    (place / "site" / "lab_pack").mkdir(parents=True)
    (place / "site" / "lab_pack" / "lights.py").write_text(PACKAGE)
    return place


@pytest.fixture(scope="module")
def bpn(place: Path, command: Command) -> Bpn:
    paths = os.pathsep.join([str(place / "site"), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths, "IMPORTED": str(place / "imported")}

    def run(*words: str, **more: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            command(*words, "--runs-dir", str(place / "runs")),
            capture_output=True, text=True, timeout=180, check=False, env=environment | more,
        )  # fmt: skip

    return run


@pytest.fixture(scope="module")
def trained(bpn: Bpn, place: Path) -> RunFolder:
    done = bpn("train", *OPTIONS, "--json")
    assert done.returncode == 0, done.stderr
    assert "the policy sees the environment's observations" in done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return RunFolder.open(place / "runs", result["run_id"])


def test_arguments_wrappers_and_what_is_seen_reach_the_robots_process(
    trained: RunFolder, place: Path
) -> None:
    config = trained.config()
    assert (config.actions, config.frames_from) == (3, "observations")
    for iteration in range(2):
        for number in range(2):
            data = trained.episode_path(iteration, number).read_bytes()
            episode = Episode.decode(data, config.task_spec)
            assert episode.frames.shape == (10, 3, 84, 84)
            for step, frame in enumerate(episode.frames):
                expected = np.zeros((3, 84, 84), np.uint8)
                expected[:, :, : 2 * step] = np.reshape([100, 50, 25], (3, 1, 1))
                np.testing.assert_array_equal(frame, expected)
            assert episode.rewards.tolist() == [[-1, 0, 1][a] for a in episode.actions]
    imported = set((place / "imported").read_text().split())
    assert len(imported) >= 2  # whoever tried it out, and the run's robot
    assert str(os.getpid()) not in imported


def test_what_was_learned_of_differences_is_verified(trained: RunFolder, bpn: Bpn) -> None:
    done = bpn("verify", str(trained.run))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all agrees" in done.stdout


def test_a_run_folder_makes_no_command_import_unless_it_is_allowed(
    trained: RunFolder, bpn: Bpn, place: Path
) -> None:
    before = (place / "imported").read_text()
    run = str(trained.run)
    for words in (["eval", run, "--trials", "1"], ["train", "--resume", run]):
        done = bpn(*words)
        assert done.returncode == 2, done.stdout + done.stderr
        assert "needs the module 'lab_pack.lights', which is not allowed here" in done.stderr
        assert "--allow-gym-modules lab_pack, or set BPN_GYM_MODULES=lab_pack" in done.stderr
    assert (place / "imported").read_text() == before
    for words, more in (
        (["--allow-gym-modules", "lab_pack"], {}),
        ([], {"BPN_GYM_MODULES": "lab_pack.lights"}),
    ):
        done = bpn("eval", run, "--trials", "1", "--json", *words, **more)
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["lengths"] == [9]


def test_wrong_arguments_are_the_environments_own_words(bpn: Bpn) -> None:
    words = ["--env-kwargs", '{"color": 1}']
    done = bpn("train", TASK, *words)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith(f"bpn: {TASK} cannot be made: TypeError")
    assert "unexpected keyword argument 'color'" in line
