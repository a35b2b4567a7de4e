"""`bpn-dashboard`: runs, their registry, the live view and the web UI, in one process."""

import argparse
import asyncio
import json
import logging
import os
import socket
import sys
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from urllib.parse import urlsplit

from fastapi import FastAPI
from starlette.requests import HTTPConnection

from bpn_dashboard.access.connections import (
    Connections,
    Listener,
    quiet_when_out_of_descriptors,
    raise_descriptor_limit,
)
from bpn_dashboard.access.tokens import LINK_S
from bpn_dashboard.alerts.watch import AlertWatch, Tell
from bpn_dashboard.alerts.webhook import Deliveries
from bpn_dashboard.api.app import Application, create_app
from bpn_dashboard.api.context import Context, identify
from bpn_dashboard.api.problems import ApiError
from bpn_dashboard.certificates import OwnCertificates
from bpn_dashboard.database.engine import Database, DatabaseError
from bpn_dashboard.hub.websocket import live_route
from bpn_dashboard.live import Live, stay_joined
from bpn_dashboard.options import (
    argument_parser,
    check_options,
    database_url,
    is_secure,
    retention,
    state_dir,
    webhook,
)
from bpn_dashboard.registry.disk_usage import DiskUsage
from bpn_dashboard.registry.removals import keep_tidy
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_dashboard.series.ingest import Ingest
from bpn_dashboard.server import Server, listen
from bpn_dashboard.state_lock import ADDRESS_FILE, state_lock
from bpn_shared.bus.session import prepare_process
from bpn_shared.counters import Counters
from bpn_shared.errors import InputError, one_line
from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.trash import DAY_S, TRASH
from bpn_shared.runtime.service import end_with_supervisor, set_up_logging, stop_on_signals
from bpn_shared.spec.config import RunConfig

log = logging.getLogger(__name__)

_END_S = 10.0


def build(
    options: argparse.Namespace, database: Database, listener: Listener
) -> tuple[Application, Context]:
    """The application with all its parts; its lifespan starts and ends them."""
    counters, live = Counters(), Live()
    connections = listener.connections = Connections(counters)
    certificates = OwnCertificates(options.connect, options.certificate)
    runs = RunStore(database, options.runs_dir, read_only=live.refusal)
    context = Context(
        database=database,
        runs=runs,
        ingest=Ingest(options.runs_dir, database, counters),
        counters=counters,
        place=ConnectedWorkers(lambda: live.bus, live.told),
        topology=live.topology.snapshot,
        refusals=live.topology.refusals,
        registry=live.registry,
        certificates=certificates.current,
        obstacle=live.obstacle,
        read_only=live.read_only,
        refused=live.refused,
        secure=is_secure(options),
        open_metrics=options.open_metrics,
        connections=connections,
        state_dir=state_dir(options),
        trash_kept_s=options.trash_days * DAY_S,
    )
    stop = threading.Event()
    tell: list[Tell] = [live.publish_alert]
    following: list[tuple[str, Callable[[], None]]] = []
    if (address := webhook(options)) is not None:
        deliveries = Deliveries(address, counters, stop)
        context.webhook_trouble = lambda: deliveries.trouble
        tell.append(deliveries.put)
        following.append(("webhook", deliveries.follow))
    alerts = AlertWatch(
        database, runs, context.series, live.topology.snapshot, tell,
        serving=lambda: live.read_only() is None,
    )  # fmt: skip
    usage, rule = DiskUsage(database, options.runs_dir), retention(options)
    following += [
        ("tidy", lambda: keep_tidy(context.removals, rule, stop)),
        ("disk usage", lambda: usage.follow(stop)),
        ("samples", lambda: context.samples.follow(stop)),
        ("alerts", lambda: alerts.follow(stop)),
    ]

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        quiet_when_out_of_descriptors(asyncio.get_running_loop(), counters)
        watching = asyncio.create_task(connections.watch())
        await asyncio.to_thread(runs.adopt)  # whether the bus is reached or not
        runs.audience.subscribe(context.ingest.take_in)
        runs.audience.subscribe(live.publish)
        runs.audience.mourn(live.publish_gone)
        context.ingest.start()
        certificates.start()
        joining = asyncio.create_task(stay_joined(options, context, live, stop))
        threads = [
            threading.Thread(target=target, name=name, daemon=True) for name, target in following
        ]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            stop.set()
            watching.cancel()
            await joining
            for thread in threads:
                await asyncio.to_thread(thread.join, _END_S)
            await asyncio.to_thread(context.ingest.close)
            await asyncio.to_thread(certificates.close)

    def may_watch(connection: HTTPConnection) -> str | None:
        try:
            identity = identify(connection)
        except ApiError:  # too many wrong tokens
            return None
        return None if identity is None else identity.owner

    routes = [live_route(lambda: live.hub, may_watch)]
    hosts, public = [options.host, *options.allow_host], urlsplit(options.public_url or "")
    if public.hostname:
        hosts.append(public.hostname)
    app = create_app(context, hosts=hosts, prefix=public.path, lifespan=lifespan, routers=routes)
    return app, context


def main(argv: list[str] | None = None) -> int:
    """Serves until it is told to stop. Exit status: 0 stopped, 1 failed, 2 wrong options."""
    options = argument_parser().parse_args(argv)
    set_up_logging("dashboard")
    prepare_process()
    logging.getLogger("alembic").setLevel(logging.WARNING)
    raise_descriptor_limit()
    stop = stop_on_signals()
    end_with_supervisor()
    with ExitStack() as stack:
        try:
            check_options(options)
            first_run = RunConfig.for_task(options.first_run) if options.first_run else None
            options.runs_dir.mkdir(parents=True, exist_ok=True)
            state_dir(options).mkdir(mode=0o700, parents=True, exist_ok=True)
            with suppress(
                OSError
            ):  # while there is room: a disk that is full later may have none even for it
                (options.runs_dir / TRASH).mkdir(exist_ok=True)
            stack.enter_context(state_lock(state_dir(options)))
            listener = listen(options.host, options.port)
            stack.callback(listener.close)
            database = Database(database_url(state_dir(options), options.database))
            stack.callback(database.close)
            app, context = build(options, database, listener)
            if first_run is not None and not any(options.runs_dir.glob("*/config.json")):
                context.runs.create(first_run, name="first run", actor="bpn-dashboard")
            stack.enter_context(_announced(options, listener, context))
        except (InputError, DatabaseError) as error:
            log.error("%s", error)
            return 2
        except OSError as error:  # folders and files that the options name
            log.error("%s", one_line(error))
            return 2
        Server(app, listener, options.certificate, options.key).serve_until(stop)
    return 0


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
    write_atomically(path, json.dumps(address).encode(), mode=0o600)
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
