"""A router that joins another one says when it is not joined, why, and when it is: once each."""

import contextlib
import logging
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from bpn_shared.bus.router import configure, upstream_of
from bpn_shared.bus.upstream import UpstreamLine

WaitFor = Callable[..., None]
RunningRouter = Callable[[str], contextlib.AbstractContextManager[None]]


def test_the_line_to_another_router_is_spoken_of_when_it_changes(
    running_router: RunningRouter, free_tcp_endpoint: str, tmp_path: Path, wait_for: WaitFor,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    caplog.set_level(logging.INFO)
    config = configure(f"unixsock-stream/{tmp_path}/router.sock", upstream=free_tcp_endpoint)
    assert upstream_of(config) == free_tcp_endpoint
    line = UpstreamLine(upstream_of(config), None)

    def said() -> list[str]:
        return [r.getMessage() for r in caplog.records if r.name == "bpn_shared.bus.upstream"]

    with zenoh.open(config) as session:

        def look(expected: str) -> bool:
            line.look(session)
            return bool(said()) and expected in said()[-1]

        wait_for(lambda: look("nobody listens"), "the reason")
        for _ in range(20):
            line.look(session)
        assert len(said()) == 1
        with running_router(free_tcp_endpoint):
            wait_for(lambda: look(f"joined the router at {free_tcp_endpoint}"), "the router")
            for _ in range(20):
                line.look(session)
            assert len(said()) == 2
        wait_for(lambda: look("is not joined"), "the loss")
        assert len(said()) <= 4  # at the first look its reason may not be known yet


def test_a_router_that_joins_nobody_says_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    config = configure(f"unixsock-stream/{tmp_path}/router.sock")
    assert upstream_of(config) is None
    with zenoh.open(config) as session:
        UpstreamLine(None, None).look(session)
    assert not caplog.records
