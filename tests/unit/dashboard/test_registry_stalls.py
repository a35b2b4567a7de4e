import logging
from typing import Any

import pytest
from logged import lines

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.stalls import NOTHING, Stalls
from bpn_shared.runtime.watchdog import STALLED_AFTER_S, Circumstances
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task("reaching").model_dump()
QUEUED = Circumstances(queue="waits for a learner: 0 connected")
BEHIND = Circumstances(queue="2 runs before it")


def row(**more: Any) -> RunRow:
    given = {"id": "a", "state": "running", "desired_state": "running", "iteration": 0}
    return RunRow(**(given | {"config": CONFIG, "archived_at": None} | more))


def test_a_stall_is_logged_when_it_begins_and_when_it_ends_and_shown_in_between(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    stalls = Stalls()
    assert stalls.columns(row(), Circumstances(), 0.0) == NOTHING
    assert stalls.columns(row(), Circumstances(), STALLED_AFTER_S - 1) == NOTHING
    shown = [
        stalls.columns(row(), Circumstances(disk=disk), STALLED_AFTER_S + n)
        for n, disk in enumerate(["", "", "the disk is full"])
    ]
    assert [columns["waiting_reason"] for columns in shown] == [
        "nobody reports from it", "nobody reports from it", "the disk is full",
    ]  # fmt: skip
    assert len({columns["waiting_since"] for columns in shown}) == 1
    assert stalls.columns(row(iteration=1), Circumstances(), 50.0) == NOTHING
    assert len(lines(caplog, Stalls)) == 2
    assert lines(caplog, Stalls)[0] == "run a has made no progress for 30 s: nobody reports from it"
    assert lines(caplog, Stalls)[1].startswith("run a goes on after ")


def test_a_queued_run_says_at_once_what_it_waits_for_and_its_time_begins_when_it_runs(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stalls = Stalls()
    queued = row(state="queued")
    assert stalls.columns(queued, QUEUED, 0.0)["waiting_reason"] == QUEUED.queue
    assert stalls.columns(queued, BEHIND, 100.0)["waiting_reason"] == BEHIND.queue
    assert lines(caplog, Stalls) == []  # a long queue is nothing that is wrong
    stalls.columns(queued, QUEUED, 101.0)
    assert len(lines(caplog, Stalls)) == 1
    assert stalls.columns(row(), Circumstances(), 102.0) == NOTHING
    assert stalls.columns(row(), Circumstances(), 102.0 + STALLED_AFTER_S) != NOTHING


@pytest.mark.parametrize(
    "change", [{"desired_state": "stopped"}, {"state": "finished"}, {"archived_at": 1.0}]
)
def test_a_run_that_nobody_wants_waits_for_nothing(change: dict[str, Any]) -> None:
    stalls = Stalls()
    stalls.columns(row(), Circumstances(), 0.0)
    assert stalls.columns(row(), Circumstances(), 40.0) != NOTHING
    assert stalls.columns(row(**change), Circumstances(), 41.0) == NOTHING
    assert stalls.columns(row(), Circumstances(), 42.0) == NOTHING  # wanted anew
