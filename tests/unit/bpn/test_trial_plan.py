"""What trials are played with, beside what the run was trained with."""

import pytest

from bpn.evaluation.trials import TrialPlan
from bpn_shared.spec.config import ConfigError, RunConfig

TRAINED = RunConfig.for_task(
    "reaching", pacing="realtime", action_delay_ms=5, disturb="noise=5,latency=10..30"
)


def test_in_lockstep_a_run_is_played_without_its_latency() -> None:
    plan = TrialPlan(
        1, "greedy", 3, {"pacing": "lockstep", "action_delay_ms": 0.0, "disturb": None}
    )
    config = plan.config(TRAINED)
    assert config.disturb == "noise=5"
    assert config.task_spec.disturbances == {"noise": (5, 5)}


def test_in_realtime_it_keeps_it() -> None:
    assert TrialPlan(1, "greedy", 3, {}).config(TRAINED).disturb == TRAINED.disturb


def test_latency_that_is_asked_for_in_lockstep_is_refused() -> None:
    changes = {"pacing": "lockstep", "action_delay_ms": 0.0, "disturb": "latency=5"}
    with pytest.raises(ConfigError, match="latency means nothing in lockstep"):
        TrialPlan(1, "greedy", 3, changes).config(TRAINED)
