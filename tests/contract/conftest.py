"""The live view as browsers get it: a real server, real WebSockets, real Zenoh."""

import contextlib
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from fastapi import FastAPI
from live_view import OpenBus, Server, Tab, WaitFor
from loop_parts import Running, Scene
from registry_world import Puppet, Registry

from bpn_dashboard.access.guard import Guard
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.hub.hub import Hub
from bpn_dashboard.hub.topology import Topology
from bpn_dashboard.hub.websocket import UVICORN_OPTIONS, live_route
from bpn_dashboard.registry import desk, losses, states
from bpn_dashboard.registry.store import RunStore
from bpn_shared.bus.session import Bus
from bpn_shared.messages.lease import Role


@pytest.fixture
def server(open_bus: OpenBus, tmp_path: Path, wait_for: WaitFor) -> Iterator[Server]:
    bus, made = open_bus(), Server(tmp_path)

    @contextlib.asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        made.hub = Hub(bus, tmp_path, made.counters, "dashboard-1", Topology())
        yield
        made.hub.close()

    app = FastAPI(lifespan=lifespan)
    app.include_router(
        live_route(lambda: made.view, lambda _connection: made.owner, session_period_s=0.05)
    )
    running = uvicorn.Server(
        uvicorn.Config(Guard(app), port=0, log_level="error", **UVICORN_OPTIONS)
    )
    thread = threading.Thread(target=running.run)
    thread.start()
    wait_for(lambda: running.started, "the server to start")
    made.port = running.servers[0].sockets[0].getsockname()[1]
    yield made
    running.should_exit = True
    thread.join(20)
    assert not thread.is_alive()


@pytest.fixture
def tab(server: Server) -> Iterator[Callable[..., Tab]]:
    opened: list[Tab] = []

    def open_tab(**options: Any) -> Tab:
        opened.append(Tab(server, **options))
        return opened[-1]

    yield open_tab
    for each in opened:
        each.close()


@pytest.fixture
def running(open_bus: OpenBus) -> Iterator[Callable[..., Running]]:
    """Starts services that end with the test, and must end well."""
    started: list[Running] = []

    def start(*arguments: Any) -> Running:
        started.append(Running(open_bus(), *arguments))
        return started[-1]

    yield start
    for each in started:
        each.end()


@pytest.fixture
def scene(open_bus: OpenBus, running: Callable[..., Running]) -> Iterator[Callable[..., Scene]]:
    """Makes scenes, whose robots end with the test."""
    made: list[Scene] = []

    def make(*arguments: Any) -> Scene:
        made.append(Scene(open_bus, running, *arguments))
        return made[-1]

    yield make
    for each in made:
        each.end()


@pytest.fixture
def registry(
    tmp_path: Path, open_bus: Callable[[], Bus], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Registry]:
    """One that waits for nothing longer than it must."""
    monkeypatch.setattr(desk, "SETTLE_S", 0.3)
    monkeypatch.setattr(losses, "SURELY_DEAD_S", 0.2)
    monkeypatch.setattr(states, "LOST_AFTER_S", 0.5)
    database = Database(sqlite_url(tmp_path / "dashboard.sqlite"))
    registry = Registry(RunStore(database, tmp_path / "runs"), open_bus)
    registry.begin()
    yield registry
    registry.end()
    database.close()


@pytest.fixture
def hire(open_bus: Callable[[], Bus]) -> Callable[[Role], Puppet]:
    """Makes workers."""
    made = 0

    def make(role: Role) -> Puppet:
        nonlocal made
        made += 1
        return Puppet(role, f"{role.replace('_', '-')}-{made}", open_bus)

    return make
