"""Who may write into a run folder: the learner of the newest attempt, and it proves that before each write.

A process may be frozen between the proof and the write. So the proof comes when all is done but the last step, and
whoever begins the next attempt takes from under that step what it needs: the file that would be put in its place,
or the place of the file that is open for appending.
"""

import contextlib
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bpn_shared.bnn.weights import Weights
from bpn_shared.runs.best import encode_best
from bpn_shared.runs.files import remove_unfinished, shut_out_appenders, write_atomically
from bpn_shared.runs.lock import OwnershipLostError
from bpn_shared.runs.state import ENDED, RunState, State

if TYPE_CHECKING:
    from bpn_shared.runs.folder import RunFolder


class Ownership:
    """One learner's right to write, for one attempt. Its methods may be called from any thread.

    All of them raise `OwnershipLostError` if a higher attempt has begun, or somebody said how this one ended; then
    nothing is written.

    Attributes:
        attempt: 0 before `begin_attempt`.
    """

    def __init__(self, folder: "RunFolder", owner: str) -> None:
        self.folder, self._owner = folder, owner
        self._lock = threading.RLock()
        self._proven: tuple[int, ...] | None = None
        self.attempt = 0

    def begin_attempt(self) -> int:
        """Makes this learner the run's, and every earlier one a stranger to it."""
        with self._lock:
            found = self.folder.state()
            self.attempt = found.attempt + 1
            self.folder.write_state("running", attempt=self.attempt, owner=self._owner)
            ended_itself = found.owner and found.state in ENDED
            if found.attempt and not ended_itself:
                self._shut_out()
            return self.attempt

    def _shut_out(self) -> None:
        """Of the owner before, who has not said that it ended, the last step of a write that it has begun."""
        path = self.folder.path
        for folder, names in (
            (path, "state.json"),
            (path, "checkpoint.safetensors"),
            (path / "weights", "*"),
            (path / "episodes", "*"),
        ):
            remove_unfinished(folder, names)
        for name in ("metrics.jsonl", "rewards.jsonl"):
            shut_out_appenders(path / name, root=path.parent)

    def prove(self) -> None:
        """Looks whether the folder still is this learner's.

        state.json is replaced, never changed: while the same file stands there, it says the same. It is opened for
        that, because opening makes network file systems look.
        """
        try:
            with self.folder.open_file("state.json") as file:
                standing = _identity(os.fstat(file.fileno()))
        except OSError:
            standing = None
        if standing is not None and standing == self._proven:
            return
        found = self.folder.state()
        if (found.attempt, found.owner) != (self.attempt, self._owner):
            raise OwnershipLostError(
                f"run {self.folder.run} is at attempt {found.attempt} of {found.owner or 'nobody yet'}: "
                f"this learner, of attempt {self.attempt}, writes nothing more"
            )
        self._proven = standing

    def set_state(self, state: State, *, error: str = "") -> RunState:
        """Says what the run is doing."""
        with self._writing():
            return self.folder.write_state(
                state, error=error, attempt=self.attempt, owner=self._owner, prove=self.prove
            )

    def append_metrics(self, record: Mapping[str, Any]) -> None:
        """Adds one iteration's record; it is on disk when this returns."""
        with self._writing():
            self.folder.append_metrics(record, prove=self.prove)

    def append_rewards(self, iteration: int, rewards_px: Sequence[Sequence[float]]) -> None:
        """Adds the rewards of an iteration's steps, for each of its episodes in order."""
        with self._writing():
            self.folder.append_rewards(iteration, rewards_px, prove=self.prove)

    def write_weights(self, weights: Weights) -> None:
        """Keeps a policy; it is on disk when this returns."""
        self._write(self.folder.weights_path(weights.version), weights.encode())

    def write_episode(self, iteration: int, episode: int, data: bytes) -> None:
        """Keeps an episode as it was delivered; it is on disk when this returns."""
        self._write(self.folder.episode_path(iteration, episode), data)

    def write_checkpoint(self, data: bytes) -> None:
        """Replaces the checkpoint; it is on disk when this returns."""
        self._write(self.folder.checkpoint_path, data)

    def write_best(self, version: int, metric: str, value: float) -> None:
        """Notes the best version of the policy; it is on disk when this returns."""
        self._write(self.folder.path / "best.json", encode_best(version, metric, value))

    def set_aside(self, path: Path) -> Path:
        """Gives a file that is damaged a name under which nobody looks for it; returns the new path."""
        with self._writing():
            number = 1
            while (aside := path.with_suffix(f".damaged-{number}")).exists():
                number += 1
            path.rename(aside)
            return aside

    def _write(self, path: Path, data: bytes) -> None:
        with self._writing():
            write_atomically(path, data, root=self.folder.path.parent, prove=self.prove)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        with self._lock:
            self.prove()  # at once too: a stranger leaves not even an unfinished file
            try:
                yield
            except OSError:
                self.prove()  # the next owner may have taken the file away
                raise


def _identity(status: os.stat_result) -> tuple[int, ...]:
    """What changes when another file is put in the place of this one, or its contents are changed."""
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
