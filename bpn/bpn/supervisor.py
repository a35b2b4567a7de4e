"""Runs services as processes, restarts those that die, and stops all of them."""

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from uuid import UUID

from bpn.last_words import last_words
from bpn_shared.runtime.gym_modules import as_arguments
from bpn_shared.runtime.service import SUPERVISOR_PID
from bpn_shared.runtime.worker import EXIT_FINISHED, EXIT_UNRECOVERABLE, service_name
from bpn_shared.spec.config import RunConfig

log = logging.getLogger(__name__)

BACKOFF_FIRST_S, BACKOFF_MAX_S = 0.2, 10.0
STEADY_S = 20.0
"""A process that ran this long was well: its next restart is quick again."""
GIVE_UP_AFTER = 8
"""Deaths in a row, none of them after a steady time, that make the supervisor stop trying."""
SAME_REASON = 3
"""So many of them for one and the same reason are enough: the next start would end in the same way."""
STOP_GRACE_S = 2.0


@dataclass
class Service:
    """One process to keep running."""

    name: str
    arguments: Sequence[str]
    core: int | None = None
    """The only core that it may run on; None: any."""
    essential: bool = True
    """Whether the others are of no use without it."""
    speaks: bool = False
    """Whether its standard output is for the user, not for the log."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """Of its own, beside this process's."""
    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    log_begin: int = 0
    """Where in its log this start began."""
    deaths: int = 0
    reason: str = ""
    """Of its last death."""
    alike: int = 0
    """Deaths in a row for that reason."""
    restart_at_s: float = 0.0
    finished: bool = False
    failure: str = ""
    wrong_input: bool = False
    """Whether it failed because of what it was given."""
    restarts: int = 0

    @property
    def pid(self) -> int | None:
        return self.process.pid if self.process is not None else None


class Supervisor:
    """Keeps services running until one of them fails for good or `stop` is called.

    Args:
        services: what to run; a service that exits with 0 has finished and is not restarted.
        logs: folder for what each service says.
    """

    def __init__(self, services: Sequence[Service], logs: Path) -> None:
        self.services = services
        self._logs = logs

    def start(self) -> None:
        self._logs.mkdir(exist_ok=True)  # without its parents: a run that was removed stays removed
        for service in self.services:
            self._spawn(service)

    def _spawn(self, service: Service) -> None:
        with self._log_path(service).open("ab") as output:
            service.log_begin = output.seek(0, os.SEEK_END)
            service.process = subprocess.Popen(  # noqa: S603 - our own modules
                [sys.executable, "-m", *service.arguments],
                stdin=subprocess.DEVNULL,
                stdout=None if service.speaks else output,
                stderr=output,
                env={
                    **os.environ,
                    **quiet_threads(),
                    **service.environment,
                    SUPERVISOR_PID: str(os.getpid()),
                },
                # Ctrl-C goes to us alone, and we stop them in order. No session of its own, which Linux's
                # autogroups would schedule apart: that made camera to action 12 % longer (292, not 261 us).
                process_group=0,
            )
        if service.core is not None:
            os.sched_setaffinity(service.process.pid, {service.core})
        service.started_s = time.monotonic()

    def _log_path(self, service: Service) -> Path:
        return self._logs / f"{service.name}.log"

    def check(self) -> None:
        """Looks after every service once: notices deaths, restarts what is due."""
        now_s = time.monotonic()
        for service in self.services:
            if service.finished or service.failure:
                continue
            if service.process is None:
                if now_s >= service.restart_at_s:
                    service.restarts += 1
                    self._spawn(service)
            elif (status := service.process.poll()) is not None:
                self._died(service, status, now_s)

    def _died(self, service: Service, status: int, now_s: float) -> None:
        service.process = None
        if status == EXIT_FINISHED:
            service.finished = True
            return
        steady = now_s - service.started_s >= STEADY_S
        service.deaths = 1 if steady else service.deaths + 1
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        reason = last_words(self._log_path(service), service.log_begin) if status > 0 else ""
        service.alike = (
            service.alike + 1 if reason and reason == service.reason and not steady else 1
        )
        service.reason = reason
        service.wrong_input = status == EXIT_UNRECOVERABLE
        if (
            service.wrong_input
            or service.deaths >= GIVE_UP_AFTER
            or (reason and service.alike >= SAME_REASON)
        ):
            service.failure = f"{service.name}: {reason or how} (see {self._log_path(service)})"
            if not service.essential:  # whoever runs the others goes on, and would not say it
                log.error("%s", service.failure)
            return
        delay_s = min(BACKOFF_FIRST_S * 2 ** (service.deaths - 1), BACKOFF_MAX_S)
        service.restart_at_s = now_s + delay_s
        log.warning(
            "%s ended with %s, starts again in %.1f s%s",
            service.name, how, delay_s, f": {reason}" if reason else "",
        )  # fmt: skip

    @property
    def failure(self) -> str:
        """Why the services cannot go on, or an empty string."""
        return "" if self.failed is None else self.failed.failure

    @property
    def failed(self) -> Service | None:
        """The service without which the others cannot go on, if one failed for good."""
        return next((s for s in self.services if s.essential and s.failure), None)

    def service(self, name: str) -> Service:
        """The service of that name.

        Raises:
            KeyError: there is none.
        """
        for service in self.services:
            if service.name == name:
                return service
        raise KeyError(name)

    def wait(self, name: str, stop: threading.Event, interval_s: float = 0.05) -> None:
        """Looks after the services until `name` has finished, something failed for good, or `stop`."""
        while not (self.service(name).finished or self.failure or stop.wait(interval_s)):
            self.check()

    def stop(self) -> None:
        """Ends all processes: SIGTERM, and SIGKILL for what is left after the grace time.

        The router, which is first, is ended when the others have gone: closing a session with a router
        that does not answer any more takes 10 s.
        """
        deadline_s = time.monotonic() + STOP_GRACE_S
        for services in (self.services[1:], self.services[:1]):
            running = [service.process for service in services if service.process is not None]
            for process in running:
                process.terminate()
            for process in running:
                try:
                    process.wait(max(0.1, deadline_s - time.monotonic()))
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        for service in self.services:
            service.process = None


def quiet_threads() -> dict[str, str]:
    """Environment that keeps numerical libraries from spinning on each other's cores.

    Two busy torch threads beside other processes on two cores ran forty times slower than one.
    """
    return {"OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive", "OPENBLAS_NUM_THREADS": "1"}


def services_of_run(
    run: UUID,
    config: RunConfig,
    runs_dir: Path,
    endpoint: str,
    gym_modules: Collection[str] = (),
    *,
    by_router: bool = False,
) -> list[Service]:
    """Router, learners, and a robot with its edge for every slot; see `router_and_slots`."""
    router, *slots = router_and_slots(
        run, config.robots, endpoint, gym_modules, by_router=by_router
    )
    learner = ["bpn_learner", "--run", str(run), "--connect", endpoint, "--runs-dir", str(runs_dir)]
    learners = [
        Service(service_name("learner", rank), [*learner, "--slot", str(rank)])
        for rank in range(config.learners)
    ]
    return [router, *learners, *slots]


def router_and_slots(
    run: UUID,
    robots: int,
    endpoint: str,
    gym_modules: Collection[str] = (),
    *,
    by_router: bool = False,
) -> list[Service]:
    """All services of a run but its learner.

    A robot and its edge take turns, so they share a core, the first pair with the router: waking a thread
    on another core that has gone to sleep costs more than what it then does. Runs side by side start at
    different cores.

    Args:
        gym_modules: what robots may import for `gym:` tasks.
        by_router: whether frames and actions go through the router, though robot and edge are on one machine.
    """
    allow = as_arguments(gym_modules)
    cores = sorted(os.sched_getaffinity(0))
    first = run.int % len(cores)
    services = [
        Service("router", ["bpn_shared.bus.router", "--listen", endpoint], core=cores[first])
    ]
    for slot in range(robots):
        core = cores[(first + slot) % len(cores)]
        there = ["--run", str(run), "--connect", endpoint, "--slot", str(slot)]
        services.append(Service(f"robot-{slot}", ["bpn_robot_sim", *there, *allow], core=core))
        edge = ["bpn_edge", *there, *(["--by-router"] if by_router else [])]
        services.append(Service(f"edge-{slot}", edge, core=core))
    return services
