"""A ledger of a small run, and the edge's and the training's end of it."""

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

from played import CONFIG

from bpn_learner.ledger import EpisodeLedger
from bpn_shared.counters import Counters
from bpn_shared.messages.control import NextEpisode
from bpn_shared.runs.ownership import Ownership
from bpn_shared.waiting import WaitStatus


def make(owner: Ownership, alive: set[str] | None = None, **changes: Any) -> EpisodeLedger:
    config = CONFIG.model_copy(update=changes)
    return EpisodeLedger(config, owner, alive or set(), WaitStatus(), Counters())


def ask(ledger: EpisodeLedger, slot: int, worker: str | None = None) -> tuple[str, int]:
    assignment = ledger.next(NextEpisode(slot=slot, worker=worker or f"edge-{slot}"))
    return assignment.status, assignment.episode


def wait(ledger: EpisodeLedger) -> list[int]:
    """The episodes that were collected."""
    scored = ledger.wait_complete(threading.Event(), lambda _: None)
    assert scored is not None
    return [item.episode.meta.episode for item in scored]


def stored(owner: Ownership) -> list[str]:
    return sorted(path.name for path in (owner.folder.path / "episodes").iterdir())


@contextlib.contextmanager
def stopped_soon(ledger: EpisodeLedger) -> Iterator[None]:
    """Waits as training does, and is stopped while it does; nothing was completed, nothing failed."""
    stop, began = threading.Event(), threading.Event()
    result: list[object] = []

    def collect() -> None:
        try:
            result.append(ledger.wait_complete(stop, lambda _: began.set()))
        except Exception as error:
            result.append(error)

    thread = threading.Thread(target=collect)
    thread.start()
    try:
        assert began.wait(10)
        yield
    finally:
        stop.set()
        thread.join(10)
    assert not thread.is_alive(), "a learner without episodes ignores that it is stopped"
    assert result == [None]
