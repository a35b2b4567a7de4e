"""Commands that show no run of their own say why nothing goes on, too: trials, and runs of a campaign."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import psutil
import pytest
from flags import flags
from pool import frozen

from bpn.evaluation.trials import TrialPlan, play
from bpn.reproduce.experiment import Campaign
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runtime import watchdog
from bpn_shared.spec.config import RunConfig

DEADLINE_S = 120.0
SMALL = {"iterations": 1, "epochs": 1, "hidden_units": 16, "steps": 12, "batch_size": 8}
WaitFor = Callable[..., None]


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "STALLED_AFTER_S", 3.0)
    monkeypatch.setattr(watchdog, "SILENT_AFTER_S", 2.0)


def edge() -> psutil.Process:
    (found,) = [child for child in psutil.Process().children() if "bpn_edge" in child.cmdline()]
    return found


def names_the_edge(said: list[str]) -> bool:
    return any("edge 0 is silent since" in line for line in said)


def test_trials(train: Callable[..., dict[str, Any]], wait_for: WaitFor) -> None:
    run = train("tracking", *flags(SMALL), "--episodes", "2")
    folder = RunFolder.open(Path(run["runs_dir"]), run["run_id"])
    trials = TrialPlan(4, "greedy", seed=3, changes={"pacing": "realtime"})
    said, moved = [], []
    with ThreadPoolExecutor(1) as pool:
        playing = pool.submit(
            play, folder, folder.newest_weights(), trials, threading.Event(),
            on_progress=moved.append, say=said.append,
        )  # fmt: skip
        wait_for(lambda: 1 in moved, "the first trial", DEADLINE_S)
        with frozen(edge()):
            wait_for(lambda: names_the_edge(said), "the reason", DEADLINE_S)
        assert len(playing.result(DEADLINE_S)) == 4


def test_a_run_of_a_campaign(tmp_path: Path, wait_for: WaitFor) -> None:
    config = RunConfig.for_task("reaching", episodes=200, **SMALL)
    said: list[str] = []
    campaign = Campaign(tmp_path, 1, threading.Event(), said.append)
    with ThreadPoolExecutor(1) as pool:
        training = pool.submit(campaign.train, [config])
        wait_for(lambda: list(tmp_path.glob("*/episodes/*-00003.bpne")), "episodes", DEADLINE_S)
        with frozen(edge()):
            wait_for(lambda: names_the_edge(said), "the reason", DEADLINE_S)
        (folder,) = training.result(DEADLINE_S)
    assert said[0].startswith(f"run {folder.run}: ")
    assert folder.state().state == "finished"
