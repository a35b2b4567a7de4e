"""`bpn join TOKEN`: this machine's robots and edges for the `bpn up` of another one.

The first time it makes a key and has it certified by the token, which `bpn up` or `bpn invite` printed there;
after that `bpn join` alone goes on, as after a restart. A router of this machine's own connects it, so that frames
and actions stay here.
"""

import argparse
import os
import platform
import re
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from bpn.errors import CommandError
from bpn.joined import Renewal, services_of_machine
from bpn.local_run import private_endpoint
from bpn.pool import PoolSize
from bpn.supervisor import Supervisor
from bpn.terminal import command
from bpn_certificates.joining import Machine, UnreachableError, join
from bpn_certificates.token import Token
from bpn_shared.bus.obstacle import obstacle
from bpn_shared.errors import InputError
from bpn_shared.runtime.gym_modules import add_gym_modules, allowed_modules
from bpn_shared.runtime.service import stop_on_signals
from bpn_shared.site import LONGEST, check_name

_MOST = 64
_CHECK_S = 0.05


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    parser.add_argument(
        "token", nargs="?", metavar="TOKEN", help="as printed there (default: go on as before)"
    )
    parser.add_argument("--name", help="what this machine is called there (default: its host name)")
    for name, default in (("robots", "1"), ("edges", "as robots")):
        parser.add_argument(
            f"--{name}", type=int, metavar="N", help=f"how many {name} (default {default})"
        )
    parser.add_argument(
        "--state-dir", type=Path, default=_default_state(), metavar="FOLDER",
        help="for this machine's key and certificate (default %(default)s)",
    )  # fmt: skip
    add_gym_modules(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Runs until it is interrupted: exit status 130.

    Raises:
        InputError: an option is wrong, or this machine is not admitted; the message says why.
        CommandError: nobody answers there, or the router failed for good.
    """
    size, modules = _size(options), allowed_modules(options.gym_modules)
    machine = _machine(options)
    identity = machine.identity
    print(
        f"this machine is {identity.machine} at site {identity.site} of {machine.host}", flush=True
    )
    if reason := obstacle(machine.endpoint, machine.files):
        print(f"not yet connected: {reason}; tried again until it is", file=sys.stderr, flush=True)
    services = services_of_machine(machine, size, private_endpoint(), modules)
    supervisor, stop = Supervisor(services, options.state_dir / "logs"), stop_on_signals()
    try:
        supervisor.start()
        renewal = Renewal(machine)
        threading.Thread(target=renewal.follow, args=(stop,), name="renewal", daemon=True).start()
        _supervise(supervisor, stop)
    finally:
        supervisor.stop()
    if supervisor.failure:
        raise CommandError(supervisor.failure)
    again = command("bpn", "join", "--state-dir", options.state_dir)
    print(f"stopped; this machine goes on with: {again}", file=sys.stderr)
    return 130


def _supervise(supervisor: Supervisor, stop: threading.Event) -> None:
    while not (supervisor.failure or stop.wait(_CHECK_S)):
        supervisor.check()


def _machine(options: argparse.Namespace) -> Machine:
    if not options.token:
        return Machine.load(options.state_dir)
    token = Token.parse(options.token)
    name = check_name(options.name or _own_name(), "--name")
    try:
        return join(token, name, options.state_dir)
    except UnreachableError as error:
        raise CommandError(
            f"nobody answers there: {error}; is `bpn up --listen` running, and may this machine reach it?"
        ) from error


def _own_name() -> str:
    """The host name, in the letters that names have."""
    name = re.sub("[^a-z0-9]+", "-", platform.node().partition(".")[0].lower()).strip("-")
    return name[:LONGEST].strip("-") or "robot"


def _size(options: argparse.Namespace) -> PoolSize:
    robots = 1 if options.robots is None else options.robots
    edges = robots if options.edges is None else options.edges
    for name, count in (("robots", robots), ("edges", edges)):
        if not 0 <= count <= _MOST:
            raise InputError(f"--{name} = {count} must be 0 to {_MOST}")
    return PoolSize(robots, edges, learners=0)


def _default_state() -> Path:
    home = os.environ.get("XDG_STATE_HOME")
    return (Path(home) if home else Path.home() / ".local" / "state") / "bpn" / "machine"
