"""Runs a matrix of configurations, several side by side, and plays trials with what they learned.

Whatever interrupts it, the same call goes on: finished runs and trials are recalled, stopped runs resumed.
"""

import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from pathlib import Path

from rich.progress import Progress, TaskID

from bpn.evaluation.trials import TrialPlan, play
from bpn.local_run import RunFailedError, private_endpoint, run_to_end, stalls_told
from bpn.progress import bar, bars
from bpn.reproduce.definition import StoppedError
from bpn.reproduce.manifest import Manifest, config_hash, digest
from bpn.reproduce.record import headline
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

_LOOK_S = 0.5
_ESTIMATE_S = 600.0
"""An iteration takes seconds."""


class Campaign:
    """Runs and trials in one folder.

    Args:
        runs_dir: where runs and the manifest are.
        jobs: runs side by side.
        stop: ends everything as soon as possible; nothing is lost by it.
        say: gets a line for every run that is finished, or stands still; on any thread.
    """

    def __init__(
        self, runs_dir: Path, jobs: int, stop: threading.Event, say: Callable[[str], None]
    ) -> None:
        self._runs_dir, self._jobs, self._stop, self._say = runs_dir, jobs, stop, say
        self._manifest = Manifest(runs_dir)

    def train(self, configs: Sequence[RunConfig]) -> list[RunFolder]:
        """The finished runs of these configurations, in their order.

        Raises:
            StoppedError: `stop` was set before all were finished.
            RunFailedError: some failed for good, after all others were finished.
        """
        folders = [self._manifest.folder(config) for config in configs]
        missing = [folder for folder in folders if folder.state().state != "finished"]
        finished = len(folders) - len(missing)
        if finished:
            self._say(f"{finished} of {len(folders)} runs are there already")
        failures: list[str] = []
        with (
            bars(speed_estimate_s=_ESTIMATE_S) as progress,
            ThreadPoolExecutor(self._jobs) as pool,
            self._all_or_none(),
        ):
            shown = _AllRuns(progress, folders)
            runs = {pool.submit(self._run, folder): folder for folder in missing}
            for ended in _as_they_end(runs, shown):
                try:
                    ended.result()
                except RunFailedError as error:
                    failures.append(str(error))
                    self._say(f"failed: {error}")
                if runs[ended].state().state == "finished":
                    finished += 1
                    self._say(f"{finished}/{len(folders)}  {headline(runs[ended])}")
        if self._stop.is_set():
            raise StoppedError(f"{finished} of {len(folders)} runs are finished")
        if failures:
            raise RunFailedError(f"{len(failures)} of {len(folders)} runs failed")
        return folders

    @contextmanager
    def _all_or_none(self) -> Iterator[None]:
        """Stops all runs on an error of our own: the pool would wait for their ends, for hours."""
        try:
            yield
        except BaseException:
            self._stop.set()
            raise

    def _run(self, folder: RunFolder) -> None:
        if not self._stop.is_set():
            endpoint = private_endpoint()
            told = stalls_told(folder, endpoint, self._stop, self._say)
            run_to_end(folder, endpoint=endpoint, stop=self._stop, display=told)

    def play(self, folder: RunFolder, trials: TrialPlan) -> list[Episode]:
        """The trials with the newest weights of a finished run, played once and kept.

        Raises:
            StoppedError: `stop` was set before all were played.
            RunFailedError: they cannot be played.
        """
        weights, config = folder.newest_weights(), trials.config(folder.config())
        name = digest(
            {
                "weights": weights.content_sha256(),
                "config": config_hash(config),
                "policy": trials.policy,
                "trials": trials.count,
            }
        )
        kept = self._runs_dir / "trials" / name
        episodes = _recall(kept, config, trials.count)
        if episodes is None:
            with bar("trials", trials.count) as over:
                episodes = play(folder, weights, trials, self._stop, on_progress=over, say=over.say)
            if self._stop.is_set():
                raise StoppedError("trials were being played")
            kept.mkdir(parents=True, exist_ok=True)
            for trial, episode in enumerate(episodes):
                write_atomically(_trial_path(kept, trial), episode.encode())
        return episodes


def _as_they_end(runs: Collection[Future[None]], shown: "_AllRuns") -> Iterator[Future[None]]:
    waiting = set(runs)
    while waiting:
        ended, waiting = wait(waiting, timeout=_LOOK_S)
        shown.update()
        yield from ended


def _recall(kept: Path, config: RunConfig, count: int) -> list[Episode] | None:
    try:
        return [
            Episode.decode(_trial_path(kept, trial).read_bytes(), config.task_spec)
            for trial in range(count)
        ]
    except (FileNotFoundError, MessageError):
        return None


def _trial_path(kept: Path, trial: int) -> Path:
    return kept / f"{trial:05d}.bpne"


class _AllRuns:
    """Counts iterations, of which every run of a target has about equally long ones."""

    def __init__(self, progress: Progress, folders: Sequence[RunFolder]) -> None:
        self._progress = progress
        self._total = {folder.path: folder.config().iterations for folder in folders}
        self._done: dict[Path, int] = {}
        self._task: TaskID = progress.add_task("iterations", total=sum(self._total.values()))
        self.update()

    def update(self) -> None:
        for path, total in self._total.items():
            if self._done.get(path, 0) < total:
                self._done[path] = len(RunFolder(path).metrics())
        self._progress.update(self._task, completed=sum(self._done.values()))
