"""`bpn up`: the dashboard, and workers that do what is started there."""

import argparse
import socket
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from bpn.certified import can_sign, check, folder_of, hosts, prepare
from bpn.dashboard import Dashboard, DashboardAwayError
from bpn.local_run import RunFailedError, private_endpoint
from bpn.options import add_runs_dir
from bpn.outputs import check_runs_dir
from bpn.pool import PoolSize, services_of_pool
from bpn.supervisor import Supervisor
from bpn.terminal import command
from bpn_certificates.book import Book
from bpn_certificates.invitations import LIFETIME_S, invite
from bpn_shared.bus.access import ROUTER
from bpn_shared.bus.endpoint import check_endpoint, network
from bpn_shared.bus.router import configure
from bpn_shared.errors import InputError
from bpn_shared.runtime.gym_modules import add_gym_modules, allowed_modules
from bpn_shared.runtime.service import stop_on_signals

_MAX_PORT = 65535
_CHECK_S = 0.05
_LOOK_S = 0.5


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    for name, default in (("learners", "1"), ("robots", "as learners"), ("edges", "as robots")):
        parser.add_argument(
            f"--{name}", type=int, metavar="N", help=f"how many {name} (default {default})"
        )
    parser.add_argument("--port", type=int, default=8000, help="0: any free one (%(default)s)")
    parser.add_argument(
        "--listen", metavar="ENDPOINT",
        help="the router's endpoint, for robots on other machines: tls/0.0.0.0:7447 (default: a private "
        "Unix socket)",
    )  # fmt: skip
    parser.add_argument(
        "--certificates", type=Path, metavar="FOLDER",
        help="what `bpn-certificates` made there (default with --listen tls/...: in the runs folder, made if "
        "there is none)",
    )  # fmt: skip
    parser.add_argument(
        "--server-name", action="append", metavar="NAME", default=[],
        help="a name or address by which other machines reach this one (default: its addresses)",
    )  # fmt: skip
    parser.add_argument(
        "--enrolment-port", type=int, metavar="PORT",
        help="where `bpn join` is answered (default: the one after the router's)",
    )  # fmt: skip
    parser.add_argument(
        "--alert-webhook",
        metavar="URL",
        help="where alerts are sent by POST, signed with --alert-secret",
    )
    parser.add_argument(
        "--alert-secret", type=Path, metavar="FILE", help="the secret that signs them"
    )
    parser.add_argument(
        "--first-run", metavar="TASK", default="",
        help="start a run of this task if there is no run yet (default: the page offers one)",
    )  # fmt: skip
    add_gym_modules(parser)
    add_runs_dir(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs until it is interrupted: exit status 130, and runs that go on at the next `bpn up`.

    Raises:
        InputError: an option is wrong, or a dashboard runs there already.
        RunFailedError: router or dashboard failed for good.
    """
    running = Dashboard.find(options.runs_dir)
    if running is not None:
        raise InputError(
            f"the runs in {options.runs_dir} have a dashboard already, at {running.url}: "
            "stop it or choose another --runs-dir"
        )
    size, port = _size(options), _port(options.port)
    certificates = _certificates(options)
    if options.listen is not None:
        router = certificates and certificates / ROUTER
        configure(options.listen, certificates=router)  # what the router would refuse
    check_runs_dir(options.runs_dir)
    enrolment_port = _enrolment_port(options, certificates)
    logs = options.runs_dir / ".logs"
    services = services_of_pool(
        size,
        options.runs_dir,
        options.listen or private_endpoint(),
        _of_dashboard(options, port),
        certificates=certificates,
        enrolment_port=enrolment_port,
        gym_modules=allowed_modules(options.gym_modules),
    )
    supervisor = Supervisor(services, logs)
    stop = stop_on_signals()
    try:
        supervisor.start()
        if certificates is not None and enrolment_port is not None:
            _say_how_to_join(options, certificates, enrolment_port)
        _supervise(supervisor, options.runs_dir, stop)
    finally:
        supervisor.stop()
    if supervisor.failure:
        wrong_input = supervisor.failed is not None and supervisor.failed.wrong_input
        raise (InputError if wrong_input else RunFailedError)(supervisor.failure)
    again = command("bpn", "up", "--runs-dir", options.runs_dir)
    print(f"stopped; runs that were not finished go on with: {again}", file=sys.stderr)
    return 130


def _certificates(options: argparse.Namespace) -> Path | None:
    """The folder with everybody's certificates, which are made if it is the runs folder's own.

    Raises:
        InputError: they cannot be used.
    """
    listen: str | None = options.listen
    given: Path | None = options.certificates
    if listen is None:
        of_network = {
            "--certificates": given,
            "--server-name": options.server_name,
            "--enrolment-port": options.enrolment_port,
        }
        for name, value in of_network.items():
            if value not in (None, []):
                raise InputError(f"{name} is for a router that others reach: add --listen")
        return None
    if given is None and not listen.startswith("tls/"):
        return None
    folder = given or folder_of(options.runs_dir)
    if given is None:
        check_endpoint(listen)
        parts = network(listen)
        if parts is not None and parts.port == 0:
            raise InputError(f"--listen {listen}: other machines need a port that stays, 7447 say")
        check_runs_dir(options.runs_dir)
        prepare(folder, listen, options.server_name)
    check(folder, listen)
    return folder


def _enrolment_port(options: argparse.Namespace, certificates: Path | None) -> int | None:
    """Where machines are admitted; None where none can be: the authority's key is elsewhere.

    Raises:
        InputError: it is no port, is taken, or is asked for in vain.
    """
    router = network(options.listen or "")
    if certificates is None or router is None or not router.port or not can_sign(certificates):
        if options.enrolment_port is not None:
            raise InputError(
                "--enrolment-port: nobody can be admitted here, for which --listen tls/HOST:PORT and the "
                "authority's key in the folder of certificates are needed"
            )
        return None
    port = router.port + 1 if options.enrolment_port is None else options.enrolment_port
    return _port(port, "--enrolment-port")


def _say_how_to_join(options: argparse.Namespace, certificates: Path, port: int) -> None:
    Book(certificates).place_door(hosts(certificates, options.server_name), port)
    word = invite(certificates)
    more = command("bpn", "invite", "--runs-dir", options.runs_dir)
    print(
        f"on the robot's machine, within {LIFETIME_S / 60:.0f} minutes: {command('bpn', 'join', word)}\n"
        f"for another machine: {more}",
        flush=True,
    )


def _port(wanted: int, option: str = "--port") -> int:
    """The port, if nobody listens there; for 0 a free one.

    It stays the same when the dashboard is restarted: pages that are open find it again.

    Raises:
        InputError: it is no port, or is taken.
    """
    if not 0 <= wanted <= _MAX_PORT:
        raise InputError(f"{option} = {wanted} must be 0 to {_MAX_PORT}; 0 takes any free one")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the dashboard does
        try:
            probe.bind(("127.0.0.1", wanted))
            probe.listen()
        except OSError as error:
            raise InputError(
                f"{option} = {wanted}: {error.strerror}; choose another, or 0 for any free one"
            ) from error
        port: int = probe.getsockname()[1]
        return port


def _size(options: argparse.Namespace) -> PoolSize:
    learners = 1 if options.learners is None else options.learners
    robots = max(1, learners) if options.robots is None else options.robots
    edges = robots if options.edges is None else options.edges
    for name, count in (("learners", learners), ("robots", robots), ("edges", edges)):
        if not 0 <= count <= 64:
            raise InputError(f"--{name} = {count} must be 0 to 64")
    return PoolSize(robots, edges, learners)


def _of_dashboard(options: argparse.Namespace, port: int) -> list[str]:
    """The dashboard's own options; it refuses what is wrong with them."""
    given = ["--port", str(port), "--first-run", options.first_run]
    for name in ("alert_webhook", "alert_secret"):
        value = getattr(options, name)
        if value is not None:
            given += [f"--{name.replace('_', '-')}", str(value)]
    return given


def _supervise(supervisor: Supervisor, runs_dir: Path, stop: threading.Event) -> None:
    """Keeps the services running; once the dashboard answers, says how to begin where there is no run."""
    look_at_s: float | None = time.monotonic()
    while not (supervisor.failure or stop.wait(_CHECK_S)):
        supervisor.check()
        if look_at_s is not None and time.monotonic() >= look_at_s:
            look_at_s = None if _offers_first_run(runs_dir) else time.monotonic() + _LOOK_S


def _offers_first_run(runs_dir: Path) -> bool:
    """Says how to start a run if there is none; False while the dashboard does not answer."""
    dashboard = Dashboard.find(runs_dir)
    if dashboard is None:
        return False
    try:
        if dashboard.run_count() == 0:
            start = command("bpn", "train", "reaching", "--runs-dir", runs_dir)
            print(f"no runs yet: start one there, or with: {start}", flush=True)
    except DashboardAwayError:
        return False
    return True
