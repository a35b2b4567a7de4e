"""Runs are removed and restored under workers that learn them, or were about to."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pool import running_pool

from bpn.dashboard import DashboardError
from bpn.options import add_run_options
from bpn_shared.runs.folder import RunOwnedError
from bpn_shared.runs.trash import Trash

LONG_S = 150.0


def test_a_run_is_removed_in_the_middle_and_goes_on_when_it_is_restored(
    tmp_path: Path, small: list[str], undisturbed: dict[str, Any], wait_for: Callable[..., None]
) -> None:
    parser = argparse.ArgumentParser()
    add_run_options(parser, small)
    given = {key: int(value) for key, value in vars(parser.parse_args(small)).items() if value}
    with running_pool(tmp_path / "runs") as pool:
        dashboard, trash = pool.dashboard, Trash(pool.runs_dir)
        run = dashboard.create_run({"task": "reaching", "seed": 5, **given})["id"]
        folder = pool.folder(run)
        wait_for(lambda: folder.episode_path(0, 1).exists(), "the middle", LONG_S)
        with pytest.raises(DashboardError, match="is running: stop it before removing it"):
            dashboard.remove(run)
        with pytest.raises(RunOwnedError, match="is being learned by learner"):
            trash.put(run, "another machine")
        dashboard.stop(run)
        wait_for(lambda: pool.state(run) == "stopped", "the run to stop", LONG_S)
        dashboard.remove(run)
        with pytest.raises(DashboardError, match="there is no run"):
            dashboard.resume(run)

        # One that workers are about to take, removed where no dashboard is asked.
        queued = dashboard.create_run({"task": "reaching", "seed": 5, **given})["id"]

        def removed() -> bool:
            try:
                trash.put(queued, "another machine")
            except RunOwnedError:  # they were faster
                dashboard.stop(queued)
                return False
            return True

        wait_for(removed, "the second run to be let go", LONG_S)
        ids = lambda: {item["id"] for item in dashboard.runs()["items"]}  # noqa: E731
        wait_for(lambda: not ids() & {run, queued}, "the registry to notice", LONG_S)

        dashboard.restore(run)
        dashboard.resume(run)
        wait_for(lambda: pool.state(run) == "finished", "the restored run", LONG_S)
        assert pool.sha256(run) == undisturbed["weights_sha256"]
        assert trash.names() == [queued]
        assert not pool.folder(queued).path.exists()
