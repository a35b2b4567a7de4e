"""One thread, as the learner computes."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from uuid import UUID

import pytest
import torch
from ledgers import make
from played import owned
from training_runs import INTERRUPTED, RUN, Runs, train

from bpn_learner.ledger import EpisodeLedger
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.ownership import Ownership

torch.set_num_threads(1)


@pytest.fixture
def owner(tmp_path: Path) -> Iterator[Ownership]:
    with owned(tmp_path) as owner:
        yield owner


@pytest.fixture
def ledger(owner: Ownership) -> EpisodeLedger:
    """One that collects iteration 0."""
    ledger = make(owner, {"edge-0", "edge-1"})
    ledger.begin(0)
    return ledger


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    whole = RunFolder.create(tmp_path_factory.mktemp("whole"), UUID(int=1), RUN)
    train(whole)
    interrupted = RunFolder.create(tmp_path_factory.mktemp("cut"), UUID(int=1), RUN)
    train(interrupted, stop_after=INTERRUPTED)
    return Runs(whole, interrupted)


@pytest.fixture
def folder(runs: Runs, tmp_path: Path) -> RunFolder:
    """A copy of the interrupted run."""
    copy = RunFolder(tmp_path / runs.interrupted.path.name)
    shutil.copytree(runs.interrupted.path, copy.path)
    return copy
