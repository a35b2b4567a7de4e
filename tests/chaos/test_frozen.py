"""Services that are frozen for a while: the run goes on elsewhere, or says what it waits for; nothing is lost."""

import json
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from flags import flags
from pool import LONG_S, frozen, running_pool

from bpn_shared.runs.folder import RunFolder

WITHIN_S = 60.0
"""A run goes on or says why it does not."""
CONFIG = {
    "task": "reaching",
    "seed": 5,
    "iterations": 4,
    "episodes": 12,
    "epochs": 2,
    "hidden_units": 24,
}
WaitFor = Callable[..., None]


@pytest.fixture(scope="module")
def undisturbed(train: Callable[..., dict[str, Any]]) -> str:
    return str(train(*options())["weights_sha256"])


def options() -> list[str]:
    return ["reaching", *flags(CONFIG)]


def test_with_an_idle_learner_beside_it_the_run_of_a_frozen_one_goes_on(
    tmp_path: Path, wait_for: WaitFor, undisturbed: str
) -> None:
    with running_pool(tmp_path, "--learners", "2") as there:
        run_id = there.dashboard.create_run(CONFIG)["id"]
        folder = RunFolder(tmp_path / run_id)
        wait_for(folder.episode_path(1, 3).exists, "the middle", LONG_S)
        with frozen(there.learner(run_id)):
            begin_s = time.monotonic()
            wait_for(lambda: there.run(run_id)["attempt"] == 2, "the other learner", WITHIN_S)
            wait_for(lambda: there.run(run_id)["iteration"] >= 2, "progress", LONG_S)
            print(f"GOES ON at another learner after {time.monotonic() - begin_s:.1f} s")
        # Thawed, the first one writes nothing: the other's attempt goes on to its end.
        wait_for(lambda: there.run(run_id)["state"] == "finished", "the end", LONG_S)
        assert there.run(run_id)["attempt"] == 2
        assert folder.newest_weights().content_sha256() == undisturbed
        again = there.dashboard.create_run(CONFIG | {"iterations": 1})["id"]
        wait_for(lambda: there.run(again)["state"] == "finished", "another run", LONG_S)


def test_without_one_the_run_says_who_is_silent_and_goes_on_when_it_thaws(
    tmp_path: Path, wait_for: WaitFor, undisturbed: str
) -> None:
    with running_pool(tmp_path) as there:
        run_id = there.dashboard.create_run(CONFIG)["id"]
        folder = RunFolder(tmp_path / run_id)
        wait_for(folder.episode_path(1, 3).exists, "the middle", LONG_S)
        owner = folder.state().owner
        sentence = f"its owner {owner} is silent since "
        with frozen(there.learner(run_id)):
            begin_s = time.monotonic()
            wait_for(lambda: sentence in there.run(run_id)["waiting_reason"], sentence, WITHIN_S)
            print(f"READABLE {sentence!r} after {time.monotonic() - begin_s:.1f} s")
            metrics = there.dashboard._http.get("/metrics").text
            assert f'bpn_run_stalled{{run="{run_id}",task="reaching"}} 1.0' in metrics
        wait_for(lambda: there.run(run_id)["state"] == "finished", "the end", LONG_S)
        assert there.run(run_id)["waiting_reason"] == ""
        assert folder.newest_weights().content_sha256() == undisturbed


def test_bpn_train_says_in_the_terminal_that_its_edge_is_silent_and_that_it_goes_on(
    tmp_path: Path, command: Callable[..., list[str]], wait_for: WaitFor, undisturbed: str
) -> None:
    said = tmp_path / "said"
    with said.open("w") as stderr:
        process = subprocess.Popen(
            command("train", *options(), "--json", "--runs-dir", str(tmp_path)),
            stdout=subprocess.PIPE, stderr=stderr, text=True,
        )  # fmt: skip
        wait_for(lambda: list(tmp_path.glob("*/episodes/000001-00003.bpne")), "the middle", LONG_S)
        (edge,) = [
            child for child in psutil.Process(process.pid).children()
            if "bpn_edge" in child.cmdline()
        ]  # fmt: skip
        with frozen(edge):
            wait_for(lambda: "no progress for 3" in said.read_text(), "the reason", WITHIN_S)
        output, _ = process.communicate(timeout=LONG_S)
    assert process.returncode == os.EX_OK
    lines = [line for line in said.read_text().splitlines() if not line.startswith("iteration")]
    assert len([line for line in lines if "no progress" in line]) == 1
    assert "edge 0 is silent since" in said.read_text()
    assert any(line.startswith("goes on after") for line in lines)
    assert json.loads(output)["weights_sha256"] == undisturbed
