"""How a worker starts: its options, its session, and whether it has a place or gets leases."""

import argparse
import logging
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from types import MappingProxyType
from uuid import UUID

from bpn_shared.bus.certificates import own_site
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.router_watch import RouterLostError, RouterWatch
from bpn_shared.bus.session import DEFAULT_ENDPOINT, Bus, BusError, prepare_process
from bpn_shared.errors import InputError, one_line
from bpn_shared.messages.lease import Role
from bpn_shared.runs.folder import RunOwnedError
from bpn_shared.runtime.heartbeat import Heartbeat
from bpn_shared.runtime.leased import UNTOLD, Abilities, LeaseLoop
from bpn_shared.runtime.service import (
    end_with_supervisor,
    new_worker_id,
    set_up_logging,
    stop_on_signals,
)
from bpn_shared.runtime.worker import (
    EXIT_FAILED,
    EXIT_FINISHED,
    EXIT_UNRECOVERABLE,
    Worker,
    WorkerMain,
    WorkerProcess,
    fetch_config,
    service_name,
)
from bpn_shared.site import MAIN_SITE
from bpn_shared.spec.config import RunConfig
from bpn_shared.version_option import add_version_option

log = logging.getLogger(__name__)


def argument_parser(kind: Role, description: str | None) -> argparse.ArgumentParser:
    """The options that every worker has."""
    parser = argparse.ArgumentParser(prog=f"bpn-{kind.replace('_', '-')}", description=description)
    add_version_option(parser)
    parser.add_argument(
        "--run", type=UUID, help="id of the run (default: whichever the registry leases)"
    )
    parser.add_argument(
        "--connect", default=DEFAULT_ENDPOINT, help="the router's endpoint (default %(default)s)"
    )
    parser.add_argument(
        "--place",
        metavar="LABEL",
        default="",
        help="where this worker runs, such as host/core; the registry puts a robot and an edge with "
        "equal labels together, or else of one host",
    )
    parser.add_argument(
        "--site",
        metavar="NAME",
        help="the site that it is at: a robot and its edge are always of one site (default: as its certificate "
        f"says, or {MAIN_SITE})",
    )
    return parser


def natural(text: str) -> int:
    """For options that count from 0.

    Raises:
        argparse.ArgumentTypeError: it does not.
    """
    if not text.isdecimal() or not text.isascii():
        raise argparse.ArgumentTypeError(f"{text!r} is no number from 0 on")
    return int(text)


Answers = Mapping[str, Callable[[bytes], bytes]]
"""By key, what a worker answers there whether it is idle or not (`Responder`'s handlers)."""


def run_worker(
    kind: Role,
    options: argparse.Namespace,
    serve: WorkerMain,
    answers: Answers = MappingProxyType({}),
    *,
    holds_on_s: float | None = None,
    abilities: Abilities = UNTOLD,
) -> int:
    """Sets up logging, signals and session, announces the worker, serves, and closes again.

    With `--run` it serves that run; without, whichever the registry leases, one after the other.

    Args:
        holds_on_s: after how long without a router it ends its work, so that another can go on with it; None:
            never.
        abilities: what the registry shall know of this worker.

    Returns:
        The exit status: what `serve` returns; `EXIT_UNRECOVERABLE` for errors that a restart cannot mend,
        `EXIT_FAILED` for others. Whatever it is, its reason is the last line of level ERROR.
    """
    slot: int = getattr(options, "slot", None) or 0
    set_up_logging(kind if options.run is None else service_name(kind, slot))
    prepare_process()
    stop = stop_on_signals()
    end_with_supervisor()
    try:
        with ExitStack() as stack:
            worker_id = new_worker_id(kind, own_site(options.site))
            heartbeat = stack.enter_context(Heartbeat(lambda: False))
            bus = stack.enter_context(Bus(options.connect, stop=stop))
            heartbeat.ready_when(lambda: bus.connected)
            process = WorkerProcess(
                kind=kind, id=worker_id, bus=bus, stop=stop, holds_on_s=holds_on_s
            )
            router = stack.enter_context(RouterWatch(bus, process.waiting, process.counters))
            process = replace(process, router=router)
            for key, handler in answers.items():
                stack.enter_context(Responder(bus, key, handler, process.counters))
            if options.run is None:
                return LeaseLoop(process, options.place, abilities).run(serve)
            return _serve_run(process, options.run, slot, serve)
    except (InputError, RunOwnedError) as error:
        log.error("%s", error)
        return EXIT_UNRECOVERABLE
    except BusError as error:
        if stop.is_set() and not isinstance(error, RouterLostError):
            return EXIT_FINISHED
        log.error("%s", error)
    except Exception as error:
        log.exception("%s", one_line(error))
    return EXIT_FAILED


def _serve_run(process: WorkerProcess, run: UUID, slot: int, serve: WorkerMain) -> int:
    with process.announced(lambda: (run, slot)), process.holding(process.stop):
        log.info("%s serves run %s, slot %d", process.id, run, slot)
        return serve(process.at(run, slot, process.bus, process.stop))


def slot_parser(kind: Role, description: str | None) -> argparse.ArgumentParser:
    """The options that every worker of one slot has."""
    parser = argument_parser(kind, description)
    parser.add_argument("--slot", type=natural, help="which robot of the run, from 0; with --run")
    return parser


def slot_options(
    parser: argparse.ArgumentParser, argv: list[str] | None = None
) -> argparse.Namespace:
    """What was given; exits where half a place was."""
    options = parser.parse_args(argv)
    if (options.run is None) != (options.slot is None):
        parser.error("--run and --slot belong together; without both the registry gives leases")
    return options


def run_slot_worker(
    kind: Role,
    options: argparse.Namespace,
    serve: Callable[[Worker, RunConfig], int],
    answers: Answers = MappingProxyType({}),
    abilities: Abilities = UNTOLD,
) -> int:
    """Runs a worker of one slot, which gets its configuration from the run's learner."""

    def serve_configured(worker: Worker) -> int:
        config = fetch_config(worker)
        return EXIT_FINISHED if config is None else serve(worker, config)

    return run_worker(kind, options, serve_configured, answers, abilities=abilities)
