"""Trials of an evaluation: what is held has an end, and what is no trial is not asked for for ever."""

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from played import CONFIG, TASK, episode

from bpn_learner import lease
from bpn_learner.evaluations import Evaluations
from bpn_learner.refusals import SAME_REASON
from bpn_learner.trials import EVALUATION, TrialLedger
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import Fault, NextEpisode
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.lock import OwnershipLostError
from bpn_shared.spec.seeds import episode_seed
from bpn_shared.waiting import WaitStatus

BLOB = replace(WeightBlob.random(CONFIG.network, np.random.default_rng(0)), attempt=2, version=4)


def make(alive: set[str] | None = None, count: int = 2) -> TrialLedger:
    return TrialLedger(CONFIG, BLOB, count=count, alive=alive)


def ask(trials: TrialLedger, slot: int) -> int | None:
    told = trials.next(NextEpisode(slot=slot, worker=f"edge-{slot}"))
    return told.episode if told.status == "play" else None


def trial(index: int, **changes: Any) -> Episode:
    seed = episode_seed(CONFIG.seed, EVALUATION, index)
    made = episode(0, index, weights_attempt=2, weights_version=4, seed=seed)
    return replace(made, meta=made.meta.model_copy(update={"iteration": EVALUATION} | changes))


def test_a_trial_whose_edge_lives_and_does_not_come_is_handed_out_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 100.0
    monkeypatch.setattr(lease.time, "monotonic", lambda: now_s)
    trials = make({"edge-0", "edge-1"}, count=1)
    assert ask(trials, 0) == 0
    now_s += lease.LEASE_S
    assert ask(trials, 1) is None
    now_s += CONFIG.steps * TASK.control_period_s + 0.01
    assert ask(trials, 1) == 0


@pytest.mark.parametrize(("index", "changes", "why"), [
    (0, {"weights_version": 3}, "played with weights version 3 of attempt 2"),
    (0, {"weights_attempt": 1}, "played with weights version 4 of attempt 1"),
    (0, {"seed": 1}, "seed 1 is another evaluation's"),
    (2, {}, "is none of the trials"),
    (0, {"iteration": EVALUATION + 1}, "is none of the trials"),
])  # fmt: skip
def test_what_is_none_of_the_trials_gets_a_receipt_and_does_not_count(
    index: int, changes: dict[str, int], why: str
) -> None:
    trials = make()
    receipt = trials.receive(trial(index, **changes).encode())
    assert receipt.status == "refused"
    assert why in receipt.reason
    assert trials.played == 0
    assert [trials.receive(trial(n).encode()).status for n in (0, 0, 1)] == [
        "stored", "duplicate", "stored",
    ]  # fmt: skip
    assert trials.over.is_set()
    assert trials.failure == ""


def test_a_trial_that_does_not_fit_the_task_is_refused_and_ends_them_when_it_comes_again() -> None:
    trials, odd = make(), replace(trial(0), actions=np.full(2, TASK.actions, np.uint8))
    for count in range(SAME_REASON):
        assert not trials.over.is_set(), count
        assert trials.receive(odd.encode()).status == "refused"
    assert trials.over.is_set()
    assert trials.failure == (
        f"trial 0 cannot be played: episode: action {TASK.actions} is outside 0..{TASK.actions - 1} "
        f"({SAME_REASON} times in a row)"
    )


def test_faults_of_another_evaluation_do_not_count() -> None:
    trials = make()
    for iteration in (EVALUATION - 1, EVALUATION + 1, EVALUATION):
        assert not trials.over.is_set()
        fault = Fault(iteration=iteration, episode=0, worker="edge-0", reason="dark")
        for _ in range(SAME_REASON):
            trials.fault(fault)
    assert trials.failure == f"trial 0 cannot be played: dark ({SAME_REASON} times in a row)"


def test_bytes_that_are_no_episode_are_to_be_sent_again() -> None:
    trials = make()
    with pytest.raises(MessageError):
        trials.receive(trial(0).encode()[:-1])
    assert not trials.over.is_set()


def test_an_evaluation_ends_when_the_run_is_another_learners() -> None:
    def prove() -> None:
        raise OwnershipLostError("another learner")

    evaluations = Evaluations(CONFIG, {"edge-0"}, WaitStatus(), prove=prove)
    with pytest.raises(OwnershipLostError):
        evaluations.play(3, BLOB, 1, threading.Event())
    assert evaluations.next(NextEpisode(slot=0, worker="edge-0")) is None
