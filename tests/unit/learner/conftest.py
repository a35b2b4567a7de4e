"""One thread, as the learner computes."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from ledgers import make
from played import owned

from bpn_learner.ledger import EpisodeLedger
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
