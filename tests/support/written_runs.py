"""Runs whose folders a test writes, as another program would: there at once, without a worker."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any
from uuid import UUID

import uuid_utils

from bpn_shared.runs.environment import Environment, write_environment
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig


def say(folder: RunFolder, first: int, lines: int, text: str = "said") -> None:
    """Adds lines to the learner's log."""
    with (folder.logs / "learner.log").open("a") as log:
        for i in range(first, first + lines):
            at = datetime.fromtimestamp(1.79e9 + i, UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")
            log.write(f"{at} learner INFO {text} {i}\n")


def make_run(
    dashboard: Any, wait_for: Callable[..., None],
    *, attempts: int = 2, each: int = 10, error: str = "", **changes: object,
) -> RunFolder:  # fmt: skip
    """A run that another program made: resumed once, failed or finished, with a long log.

    Args:
        each: iterations of an attempt.
        changes: of the configuration.
    """
    run = UUID(str(uuid_utils.uuid7()))
    config = RunConfig.for_task("reaching", **{"iterations": 20, **changes})
    folder = RunFolder.create(dashboard.runs_dir, run, config)
    folder.logs.mkdir(exist_ok=True)
    with folder.owned("learner-1") as owner:
        for attempt in range(attempts):
            owner.begin_attempt()
            here = Environment.here(owner.attempt, "learner-1")
            here = here.model_copy(update={"host": f"machine-{attempt}"})
            write_environment(folder, here, prove=owner.prove)
            for i in range(each * attempt, each * attempt + each):
                folder.append_metrics(
                    {
                        "iteration": i, "attempt": owner.attempt, "return_px": -300.0 + i, "length": 20.0,
                        "loss": None if i > 14 else 0.5, "weights_version": i + 1, "iteration_s": 5.0,
                        "time_unix_s": 1.79e9 + 5 * i + 86_400 * attempt,
                    }
                )  # fmt: skip
        owner.set_state("failed" if error else "finished", error=error)
    say(folder, 0, 300)
    wait_for(lambda: str(run) in {one["id"] for one in dashboard.runs()}, "the run to be found")
    return folder
