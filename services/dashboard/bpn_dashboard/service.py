"""`bpn-dashboard`: runs, their registry, the live view and the web UI, in one process."""

import argparse
import asyncio
import json
import logging
import os
import socket
import sys
import threading
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import uvicorn
from fastapi import FastAPI
from starlette.requests import HTTPConnection

from bpn_dashboard.access.tokens import LINK_S
from bpn_dashboard.api.app import Application, create_app
from bpn_dashboard.api.context import Context, identify
from bpn_dashboard.api.models import Run
from bpn_dashboard.api.problems import ApiError
from bpn_dashboard.database.engine import Database, DatabaseError
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.hub import presence
from bpn_dashboard.hub.hub import Hub
from bpn_dashboard.hub.topology import Topology
from bpn_dashboard.hub.websocket import UVICORN_OPTIONS, live_route
from bpn_dashboard.options import (
    argument_parser,
    check_options,
    database_url,
    is_secure,
    state_dir,
)
from bpn_dashboard.registry.dispatcher import Dispatcher
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series.ingest import Ingest
from bpn_shared.bus.session import Bus, BusError
from bpn_shared.config import ConfigError, RunConfig
from bpn_shared.runs.files import write_atomically
from bpn_shared.service import (
    Counters,
    end_with_supervisor,
    new_worker_id,
    set_up_logging,
    stop_on_signals,
)

log = logging.getLogger(__name__)

ADDRESS_FILE = ".dashboard.json"
"""In the state folder: where the dashboard is, and a token for this user's commands."""
_SHUTDOWN_S = 2


@dataclass
class Live:
    """The parts that need the message bus, which may not be reachable yet."""

    bus: Bus | None = None
    hub: Hub | None = None
    dispatcher: Dispatcher | None = None
    topology: Topology = field(default_factory=Topology)

    def obstacle(self) -> str | None:
        """What keeps workers from being given work; None: nothing."""
        if self.bus is None or self.dispatcher is None:
            return "the message bus is not reached yet"
        if not self.bus.connected:
            return f"the connection to the router at {self.bus.endpoint} is lost"
        return None if self.dispatcher.alive else "the registry does not serve workers"


def build(options: argparse.Namespace, database: Database) -> tuple[Application, Context]:
    """The application with all its parts; its lifespan starts and ends them."""
    counters, live = Counters(), Live()
    runs = RunStore(database, options.runs_dir)
    context = Context(
        database=database,
        runs=runs,
        ingest=Ingest(options.runs_dir, database, counters),
        counters=counters,
        topology=live.topology.snapshot,
        obstacle=live.obstacle,
        secure=is_secure(options),
        open_metrics=options.open_metrics,
    )

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        stop = threading.Event()
        await asyncio.to_thread(runs.adopt)  # whether the bus is reached or not
        runs.subscribe(context.ingest.take_in)
        context.ingest.start()
        joining = asyncio.create_task(_join_bus(options, context, live, stop))
        try:
            yield
        finally:
            stop.set()
            await joining
            await asyncio.to_thread(context.ingest.close)

    def may_watch(connection: HTTPConnection) -> bool:
        try:
            return identify(connection) is not None
        except ApiError:  # too many wrong tokens
            return False

    routes = [live_route(lambda: live.hub, may_watch)]
    hosts = [options.host, *options.allow_host]
    if options.public_url is not None:
        hosts.append(str(urlsplit(options.public_url).hostname))
    return create_app(context, hosts=hosts, lifespan=lifespan, routers=routes), context


async def _join_bus(
    options: argparse.Namespace, context: Context, live: Live, stop: threading.Event
) -> None:
    """Waits for the router however long it takes, runs what needs it, and ends that when `stop` is set."""
    try:
        bus = await asyncio.to_thread(Bus, options.connect, deadline_s=float("inf"), stop=stop)
    except BusError as error:
        log.info("%s", error)
        return
    name = new_worker_id(presence.KIND)
    hub = live.hub = Hub(bus, options.runs_dir, context.counters, name, live.topology)

    def publish(rows: Sequence[RunRow]) -> None:
        for row in rows:
            hub.publish("runs", Run.of(row).model_dump(mode="json"))

    context.runs.subscribe(publish)
    present = presence.Presence(bus, name, context.counters)
    dispatcher = Dispatcher(bus, context.runs, context.counters)
    await asyncio.to_thread(dispatcher.start)
    live.bus, live.dispatcher = bus, dispatcher
    await asyncio.to_thread(stop.wait)
    await asyncio.to_thread(dispatcher.close)
    hub.close()
    await asyncio.to_thread(present.close)
    await asyncio.to_thread(bus.close)


def main(argv: list[str] | None = None) -> int:
    """Serves until it is told to stop. Exit status: 0 stopped, 1 failed, 2 wrong options."""
    options = argument_parser().parse_args(argv)
    set_up_logging("dashboard")
    logging.getLogger("alembic").setLevel(logging.WARNING)
    stop = stop_on_signals()
    end_with_supervisor()
    try:
        check_options(options)
        first_run = RunConfig.for_task(options.first_run) if options.first_run else None
        listener = _listen(options.host, options.port)
        for folder in (options.runs_dir, state_dir(options)):
            folder.mkdir(parents=True, exist_ok=True)
        database = Database(database_url(state_dir(options), options.database))
    except (ConfigError, DatabaseError) as error:
        log.error("%s", error)
        return 2
    with ExitStack() as stack:
        stack.callback(database.close)
        stack.callback(listener.close)
        app, context = build(options, database)
        if first_run is not None and not any(options.runs_dir.glob("*/config.json")):
            context.runs.create(first_run, name="first run", actor="bpn-dashboard")
        stack.enter_context(_announced(options, listener, context))
        config = uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            lifespan="on",
            timeout_graceful_shutdown=_SHUTDOWN_S,
            ssl_certfile=options.certificate,
            ssl_keyfile=options.key,
            **UVICORN_OPTIONS,
        )
        server = _Server(config)
        threading.Thread(target=server.exit_after, args=(stop,), daemon=True).start()
        server.run(sockets=[listener])
    return 0


class _Server(uvicorn.Server):
    """Leaves signals to us: uvicorn's own handling ends the process by the signal, past our clean-up."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    def exit_after(self, stop: threading.Event) -> None:
        """Lets the server end when the event is set."""
        stop.wait()
        self.should_exit = True


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen()  # who follows the link at once waits for us, and is not refused
    except OSError as error:
        listener.close()
        raise ConfigError(f"--host {host} --port {port}: {error.strerror}; try --port 0") from error
    return listener


@contextmanager
def _announced(
    options: argparse.Namespace, listener: socket.socket, context: Context
) -> Iterator[None]:
    """Prints the link for the browser, and tells this user's commands where the dashboard is."""
    url = options.public_url or _url_of(options, listener, context)
    _, link = context.tokens.issue("link", "local user", "admin", lifetime_s=LINK_S)
    row, token = context.tokens.issue_for_process("local commands", "operator")
    issued = [row]
    address = {"url": url, "token": token, "endpoint": options.connect, "pid": os.getpid()}
    if options.certificate is not None:
        address["certificate"] = str(options.certificate.absolute())
    if options.metrics_token is not None:
        row, viewer = context.tokens.issue_for_process("metrics", "viewer")
        issued.append(row)
        write_atomically(options.metrics_token, viewer.encode())
    path = state_dir(options) / ADDRESS_FILE
    _write_private(path, json.dumps(address).encode())
    print(f"bpn dashboard: {url}/#token={link}", file=sys.stdout, flush=True)
    try:
        yield
    finally:
        for row in issued:
            context.tokens.revoke(row.id)
        with suppress(OSError, ValueError):
            if json.loads(path.read_bytes())["pid"] == os.getpid():
                path.unlink()


def _url_of(options: argparse.Namespace, listener: socket.socket, context: Context) -> str:
    scheme = "https" if context.secure else "http"
    name = next(iter(options.allow_host), options.host)
    name = f"[{name}]" if ":" in name else name
    return f"{scheme}://{name}:{listener.getsockname()[1]}"


def _write_private(path: Path, data: bytes) -> None:
    """A file that only this user may read, at every moment."""
    previous = os.umask(0o077)
    try:
        write_atomically(path, data)
    finally:
        os.umask(previous)
