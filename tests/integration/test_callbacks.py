"""Evaluation, the best policy, early stop and warm start with real processes."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bpn_shared.runs.folder import RunFolder

Train = Callable[..., dict[str, Any]]
SMALL = [
    "reaching",
    "--seed",
    "5",
    "--episodes",
    "2",
    "--epochs",
    "1",
    "--hidden-units",
    "16",
    "--batch-size",
    "8",
]


def test_a_run_is_evaluated_ends_early_and_another_begins_with_its_weights(
    train: Train, command: Callable[..., list[str]], tmp_path: Path
) -> None:
    plain = train(*SMALL, "--iterations", "2", runs_dir=tmp_path)
    evaluated = train(
        *SMALL, "--iterations", "9", "--lr-run-final-factor", "1", "--evaluate-every", "1",
        "--evaluate-episodes", "2", "--robots", "2", "--stop-when", "iteration>=1", runs_dir=tmp_path,
    )  # fmt: skip
    assert (evaluated["state"], evaluated["iterations"], evaluated["episodes"]) == (
        "finished",
        2,
        4,
    )
    folder = RunFolder.open(tmp_path, evaluated["run_id"])
    assert evaluated["reason"] == "stopped early after iteration 1: iteration = 1 >= 1"
    assert folder.state().error == evaluated["reason"]
    assert plain["reason"] == ""
    evaluations = [record["eval_return"] for record in folder.metrics()]
    assert folder.best().value == max(evaluations)
    assert folder.best().version == 1 + evaluations.index(max(evaluations))
    played = subprocess.run(
        command("eval", evaluated["run_id"], "--best", "--runs-dir", str(tmp_path), "--trials", "1", "--json"),
        capture_output=True, text=True, timeout=90, check=True,
    )  # fmt: skip
    assert json.loads(played.stdout)["weights_version"] == folder.best().version

    warm = train(
        *SMALL, "--iterations", "1", "--init-from", f"{plain['run_id']}:2", runs_dir=tmp_path
    )
    begun = RunFolder.open(tmp_path, warm["run_id"])
    assert begun.weights(0).content_sha256() == plain["weights_sha256"]
    assert begun.config().init_from == f"{plain['run_id']}:2:{plain['weights_sha256']}"
    assert "Adam's moments" in (begun.logs / "learner.log").read_text()
