"""What a dashboard answers who wants to change something, from the first moment of its life on."""

import argparse
import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bpn_dashboard.api.context import Context
from bpn_dashboard.live import Live, stay_joined
from bpn_dashboard.registry.election import Candidate
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters

WaitFor = Callable[..., None]


@contextmanager
def joining(endpoint: str, context: Context, folder: Path) -> Iterator[Live]:
    """The live parts of a dashboard that has just begun."""
    live, stop, begun = Live(), threading.Event(), threading.Event()
    options = argparse.Namespace(connect=endpoint, runs_dir=folder)

    async def join() -> None:
        task = asyncio.create_task(stay_joined(options, context, live, stop))
        await asyncio.sleep(0)
        begun.set()
        await task

    thread = threading.Thread(target=asyncio.run, args=(join(),))
    thread.start()
    begun.wait()
    try:
        yield live
    finally:
        stop.set()
        thread.join()


def test_the_second_refuses_from_its_first_moment_and_takes_changes_once_the_first_has_gone(
    endpoint: str, open_bus: Callable[[], Bus], context: Context, tmp_path: Path, wait_for: WaitFor
) -> None:
    first_bus = open_bus()
    first = Candidate(first_bus, "dashboard-z", lambda _: None, Counters())
    wait_for(lambda: first.serves, "the first to serve")
    with joining(endpoint, context, tmp_path) as second:
        for _ in range(200):
            assert "serves this router: read-only" in str(second.refusal())
        first.close()
        first_bus.close()
        wait_for(lambda: second.read_only() is None, "the first one's token to go")
        assert second.refusal() is None  # it waited until it served
        assert second.candidate is not None
        assert second.candidate.serves


def test_of_a_router_that_is_served_by_nobody_it_takes_changes_as_soon_as_that_is_certain(
    endpoint: str, context: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bpn_dashboard.live._JOINED_WITHIN_S", 3600.0)
    monkeypatch.setattr("bpn_dashboard.live._SETTLED_WITHIN_S", 3600.0)  # it does not wait so long
    with joining(endpoint, context, tmp_path) as live:
        assert live.refusal() is None
        assert live.candidate is not None
        assert live.candidate.serves


def test_without_a_router_runs_can_be_made_and_wait_for_it(
    context: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bpn_dashboard.live._JOINED_WITHIN_S", 0.2)
    with joining(f"unixsock-stream/{tmp_path}/none", context, tmp_path) as live:
        assert live.undecided()
        assert live.refusal() is None
        assert live.obstacle() == "the message bus is not reached yet"


def test_where_it_cannot_be_decided_the_reason_is_given_in_time(
    endpoint: str, context: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bpn_dashboard.live._SETTLED_WITHIN_S", 0.2)
    monkeypatch.setattr("bpn_dashboard.registry.election.SETTLE_S", 3600.0)
    with joining(endpoint, context, tmp_path) as live:
        assert str(live.refusal()).endswith(": try again")
