"""What learners that share an update are told, and what is done when one is lost."""

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest
import torch
from torch import Tensor
from training_runs import INTERRUPTED, RUN, Runs, shas, train

from bpn_learner import training as training_module
from bpn_learner.factory import initial_policy
from bpn_learner.group import GroupLostError, SingleProcess
from bpn_learner.handout import MAX_BYTES, receive_state
from bpn_learner.training import GIVE_UP_AFTER
from bpn_learner.update import policy_update
from bpn_shared.runs.folder import RunFolder


def losing(monkeypatch: pytest.MonkeyPatch, times: int) -> list[int]:
    """The first updates lose a learner when they are nearly done."""
    tried: list[int] = []

    def update(*arguments: Any, **more: Any) -> Any:
        report = policy_update(*arguments, **more)
        tried.append(1)
        if len(tried) <= times:
            raise GroupLostError("learner-2 is gone")
        return report

    monkeypatch.setattr(training_module, "policy_update", update)
    return tried


def test_an_update_that_lost_a_learner_begins_again_from_the_checkpoint(
    runs: Runs, folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = losing(monkeypatch, 2)
    train(folder)
    assert shas(folder) == shas(runs.whole)
    assert len(tried) == 4  # of two iterations


def test_updates_that_lose_a_learner_each_time_have_an_end(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = losing(monkeypatch, 1000)
    with pytest.raises(GroupLostError, match="learner-2"):
        train(folder)
    assert len(tried) == GIVE_UP_AFTER == 8
    assert len(folder.metrics()) == INTERRUPTED


class Handed(SingleProcess):
    """A group of one that keeps what is handed out, and hands it on to who takes it."""

    exchange_s = 1.5

    def __init__(self) -> None:
        self.told: list[Tensor] = []

    def broadcast(self, values: Tensor) -> None:
        self.told.append(values.clone())

    @contextlib.contextmanager
    def gathered(self) -> Iterator["Handed"]:
        yield self


class Taking(Handed):
    def broadcast(self, values: Tensor) -> None:
        values.copy_(self.told.pop(0))


def test_who_shares_an_update_is_told_all_of_it(runs: Runs, folder: RunFolder) -> None:
    group = Handed()
    train(folder, stop_after=5, rendezvous=group)
    assert shas(folder) == shas(runs.whole)[:5]
    assert folder.metrics()[-1]["exchange_s"] == 1.5
    assert runs.whole.metrics()[-1]["exchange_s"] == 0.0
    taking = Taking()
    taking.told = group.told[:2]
    network, optimizer = initial_policy(RUN)
    regression, iteration = receive_state(taking, network, optimizer)  # type: ignore[arg-type]
    assert iteration == INTERRUPTED
    assert len(regression.y) == 2 * RUN.episodes * RUN.steps
    before = runs.whole.weights(INTERRUPTED).content_sha256()
    assert network.export().content_sha256() == before


@pytest.mark.parametrize("size", [0, -1, MAX_BYTES + 1])
def test_what_cannot_be_an_update_is_not_waited_for(size: int) -> None:
    taking = Taking()
    taking.told = [torch.tensor([size])]
    with pytest.raises(GroupLostError, match=f"tells {size} bytes, at most"):
        receive_state(taking, *initial_policy(RUN))  # type: ignore[arg-type]
