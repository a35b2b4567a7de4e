"""One run from its folder to its end, with progress: by processes of its own, or by the dashboard's workers."""

import contextlib
import logging
import secrets
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import disk_usage
from typing import Any
from uuid import UUID

import uuid_utils
from rich.console import Console

from bpn.dashboard import Dashboard, DashboardAwayError
from bpn.errors import CommandError
from bpn.progress import bars
from bpn.stall_notice import LocalStalls, StallNotice
from bpn.supervisor import Supervisor, services_of_run
from bpn_shared.bus.metrics import MetricsSubscriber
from bpn_shared.bus.session import Bus, BusError
from bpn_shared.bus.telemetry import TelemetryWatch
from bpn_shared.counters import Counters
from bpn_shared.errors import InputError
from bpn_shared.messages.metrics import MetricsBatch
from bpn_shared.runs.folder import RunFolder, RunOwnedError
from bpn_shared.runs.state import ENDED, State
from bpn_shared.spec.config import ConfigError, RunConfig

log = logging.getLogger(__name__)


_FULL_BYTES = 2**20
_POLL_S = 0.2
_QUEUED_S = 3.0
_STOP_S = 10.0
_AWAY_S = 60.0


class RunFailedError(CommandError):
    """The run cannot go on; the message says which service failed, why, and where its log is."""


def new_run(runs_dir: Path, config: RunConfig) -> RunFolder:
    """A new run folder with a UUIDv7, so that names sort by time."""
    return RunFolder.create(runs_dir, UUID(str(uuid_utils.uuid7())), config)


def private_endpoint() -> str:
    """An endpoint that nobody listens at: a Unix socket, which only this user may connect to."""
    path = Path(tempfile.gettempdir()) / f"bpn-{secrets.token_hex(6)}.sock"
    return f"unixsock-stream/{path}"


def execute(
    folder: RunFolder,
    *,
    endpoint: str,
    stop: threading.Event,
    out: Console,
    on_started: Callable[[Supervisor], None] = lambda _: None,
) -> None:
    """Runs the run and shows how it goes.

    Prints one line per iteration to `out`; to standard error goes why there is no progress, where there is none,
    and the progress bar if that is a terminal.

    Raises:
        ConfigError: somebody else is learning the run.
        RunFailedError: a service failed for good.
    """
    config = folder.config()
    progress = _Display(folder, config, out)
    notice = StallNotice(progress.warn)
    stalls = LocalStalls(config.steps, folder.path, notice)
    display = _display(progress, folder, endpoint, stop, stalls)
    run_to_end(folder, endpoint=endpoint, stop=stop, on_started=on_started, display=display)


def run_to_end(
    folder: RunFolder,
    *,
    endpoint: str,
    stop: threading.Event,
    on_started: Callable[[Supervisor], None] = lambda _: None,
    display: contextlib.AbstractContextManager[None] | None = None,
) -> None:
    """Runs all services until the run is finished or `stop` is set; leaves no process.

    Args:
        display: what is entered while they run.

    Raises:
        ConfigError: somebody else is learning the run.
        RunFailedError: a service failed for good.
    """
    if folder.is_owned():
        raise ConfigError(
            f"run {folder.run} is being learned already: wait for its end, or stop it where it runs"
        )
    config = folder.config()
    folder.state()  # what cannot be read is said before anything starts
    supervisor = Supervisor(
        services_of_run(folder.run, config, folder.path.parent, endpoint), folder.logs
    )
    try:
        supervisor.start()
        on_started(supervisor)
        with display or contextlib.nullcontext():
            supervisor.wait("learner", stop)
    finally:
        supervisor.stop()
        end: State = "failed" if supervisor.failure else "stopped"
        failure = supervisor.failure and f"{supervisor.failure}{_of_full_disk(folder.path)}"
        try:
            folder.settle(end, error=failure, by="bpn train")
        except RunOwnedError:
            pass  # a learner elsewhere has it, which says how it ends
        except OSError as error:  # what failed before is to be told, not this alone
            log.error("the run's state could not be written: %s", error)
    if failure:
        raise RunFailedError(f"run {folder.run} failed: {failure}")


def _of_full_disk(path: Path) -> str:
    """What a log cannot say where the disk is full."""
    return f": no space left on the disk of {path}" if disk_usage(path).free < _FULL_BYTES else ""


def follow(dashboard: Dashboard, folder: RunFolder, *, stop: threading.Event, out: Console) -> None:
    """Shows a run of the dashboard's workers until it is over; when `stop` is set, stops it.

    Prints what `execute` does.

    Raises:
        RunFailedError: the run failed, or the dashboard is gone.
    """
    progress = _Display(folder, folder.config(), out)
    with _display(progress, folder, dashboard.endpoint, stop):
        _wait_until_over(dashboard, str(folder.run), stop, StallNotice(progress.warn))
    state = folder.state()
    if state.state == "failed":
        raise RunFailedError(f"run {folder.run} failed: {state.error}")


def _wait_until_over(
    dashboard: Dashboard, run_id: str, stop: threading.Event, notice: StallNotice
) -> None:
    begin_s = answered_s = time.monotonic()
    stopped_s: float | None = None
    while stopped_s is None or time.monotonic() - stopped_s < _STOP_S:
        try:
            if stop.is_set() and stopped_s is None:
                stopped_s = time.monotonic()
                dashboard.stop(run_id)
            run = dashboard.run(run_id)
            state, answered_s = run["state"], time.monotonic()
            if state != "queued" or answered_s - begin_s > _QUEUED_S:
                notice.update(run["waiting_reason"], _waiting_s(run))
        except DashboardAwayError as error:
            if stopped_s is not None or time.monotonic() - answered_s > _AWAY_S:
                raise RunFailedError(f"{error}; the run goes on where it has workers") from error
            state = "running"
        if state in ENDED:
            return
        if stopped_s is None:
            stop.wait(_POLL_S)
        else:
            time.sleep(_POLL_S)


def _waiting_s(run: dict[str, Any]) -> float:
    """How long a run of the dashboard's has made no progress."""
    since_unix_s = run["waiting_since_unix_s"]
    return 0.0 if since_unix_s is None else max(0.0, time.time() - since_unix_s)


@contextlib.contextmanager
def _display(
    display: "_Display | _NoDisplay",
    folder: RunFolder,
    endpoint: str,
    stop: threading.Event,
    stalls: LocalStalls | None = None,
) -> Iterator[None]:
    """Shows progress from a thread of its own while the body runs."""
    done = threading.Event()

    def follow() -> None:
        with contextlib.ExitStack() as stack:
            bus: Bus | None = None
            with contextlib.suppress(BusError, InputError):  # lines are in the folder all the same
                bus = stack.enter_context(Bus(endpoint, stop=done))
                stack.enter_context(MetricsSubscriber(bus, folder.run, display.on_batch))
                if stalls is not None:
                    watch = TelemetryWatch(bus, stalls.hear, Counters())
                    stack.enter_context(contextlib.closing(watch))
            while not done.wait(0.2):
                display.show_new_lines()
                if stalls is not None:
                    stalls.look(display.shown, connected=bus is not None and bus.connected)

    thread = threading.Thread(target=follow, name="progress")
    with display.progress:
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join(timeout=5.0)
            if not stop.is_set():
                display.show_new_lines()


def stalls_told(
    folder: RunFolder, endpoint: str, stop: threading.Event, say: Callable[[str], None]
) -> contextlib.AbstractContextManager[None]:
    """For `run_to_end` without a display: says why there is no progress, where there is none.

    Args:
        say: prints a line; on a thread of its own.
    """
    notice = StallNotice(lambda text: say(f"run {folder.run}: {text}"))
    stalls = LocalStalls(folder.config().steps, folder.path, notice)
    return _display(_NoDisplay(folder), folder, endpoint, stop, stalls)


class _NoDisplay:
    """Looks at a run that somebody else shows."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self.progress = contextlib.nullcontext()
        self.shown = 0

    def on_batch(self, batch: MetricsBatch) -> None:
        """Nobody sees it."""

    def show_new_lines(self) -> None:
        """Counts them."""
        self.shown = len(self._folder.metrics())


class _Display:
    def __init__(self, folder: RunFolder, config: RunConfig, out: Console) -> None:
        self._folder, self._config, self._out = folder, config, out
        self.shown = len(folder.metrics())
        self.progress = bars()
        self._iterations = self.progress.add_task(
            "iterations", total=config.iterations, completed=self.shown
        )
        self._part = self.progress.add_task("starting", total=None)

    def warn(self, text: str) -> None:
        """A line on standard error, above the bars where there are any."""
        self.progress.console.print(text, highlight=False, soft_wrap=True, markup=False)

    def on_batch(self, batch: MetricsBatch) -> None:
        """Moves the second bar: episodes while collecting, epochs while updating."""
        values = {point.name: point.value for point in batch.points}
        if "progress.episodes" in values:
            self.progress.update(
                self._part,
                description="episodes",
                total=self._config.episodes,
                completed=values["progress.episodes"],
            )
        elif "progress.epochs" in values:
            self.progress.update(
                self._part,
                description="epochs",
                total=self._config.epochs,
                completed=values["progress.epochs"],
            )

    def show_new_lines(self) -> None:
        """One line for every iteration that was finished since the last call."""
        records = self._folder.metrics()
        for record in records[self.shown :]:
            self._out.print(_line(record, self._config), highlight=False, soft_wrap=True)
        self.shown = len(records)
        self.progress.update(self._iterations, completed=self.shown)


def _line(record: dict[str, Any], config: RunConfig) -> str:
    task = config.task_spec
    return (
        f"iteration {record['iteration'] + 1:3d}/{config.iterations}"
        f"  return {record[task.return_metric]:8.1f}{task.return_unit}"
        f"  length {record['length']:5.1f}"
        f"  loss {record['loss']:8.4f}"
        f"  lambda {record['scale']:6.3f}"
        f"  {record['transitions'] / record['collect_s']:5.0f} steps/s"
        f"  {record['updates'] / record['update_s']:5.0f} updates/s"
        f"  {record['iteration_s']:5.1f} s"
    )
