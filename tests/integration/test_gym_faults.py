"""An environment that breaks in the middle of a run, through all parts: the run ends with the reason."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ENVIRONMENTS = """
import gymnasium
from gymnasium.envs.classic_control import MountainCarEnv

class Late(MountainCarEnv):
    '''Breaks where creation's look at it does not come.'''

    def reset(self, **options):
        self.steps = 0
        return super().reset(**options)

    def step(self, action):
        self.steps += 1
        state, reward, *others = super().step(action)
        if self.steps == 25:
            reward = self.breaks()
        return state, reward, *others

class Raising(Late):
    def breaks(self):
        raise ValueError("bad joint")

class Unpaid(Late):
    def breaks(self):
        return float("nan")

gymnasium.register("bpn-odd/Raising-v0", entry_point=Raising)
gymnasium.register("bpn-odd/Unpaid-v0", entry_point=Unpaid)
"""


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("Raising", "step raised ValueError: bad joint at step 25 (seed "),
        ("Unpaid", "reward nan at step 25 (seed "),
    ],
)
def test_a_run_that_cannot_go_on_says_why_and_ends(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: Callable[..., list[str]],
    name: str,
    reason: str,
) -> None:
    (tmp_path / "sitecustomize.py").write_text(ENVIRONMENTS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    done = subprocess.run(
        command(
            "train", f"gym:bpn-odd/{name}-v0", "--iterations", "1", "--episodes", "2", "--steps", "40",
            "--epochs", "1", "--hidden-units", "16", "--runs-dir", str(tmp_path / "runs"),
        ),
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    told = f"episode (0, 0) cannot be had: gym:bpn-odd/{name}-v0: {reason}"
    assert told in done.stderr.splitlines()[-1]
    (state,) = (json.loads(path.read_text()) for path in tmp_path.glob("runs/*/state.json"))
    assert (state["state"], told in state["error"]) == ("failed", True)
