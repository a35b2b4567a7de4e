"""The run folder: the truth about a run. One process writes it (its learner); anyone may read.

    config.json         the configuration, never changed
    state.json          state, attempt and whose it is, when, and why it failed
    metrics.jsonl       one line per iteration; after a crash an iteration may stand twice, the later counts
    rewards.jsonl       likewise: the rewards of every step of its episodes, in pixels
    episodes/           every episode as it was delivered, <iteration>-<episode>.bpne
    weights/            every weights version, <version>.bpnw
    initial.safetensors of a run that begins with another one's weights: that one's checkpoint
    best.json           the best version in the evaluations during training, if there are any
    checkpoint.safetensors
    logs/               what each service said

Files that are replaced are replaced atomically; what was acknowledged to others is on disk first. Everything has a
digest that is checked when it is read (docs/run-folder.md).
"""

import contextlib
import errno
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any, BinaryIO, Self
from uuid import UUID

from bpn_shared.bnn.weights import Weights, decode_weights
from bpn_shared.runs.best import Best, decode_best
from bpn_shared.runs.config_file import (
    config_schema,
    config_writer,
    decode_config,
    encode_config,
    raw_config,
)
from bpn_shared.runs.digests import seal_line
from bpn_shared.runs.files import Prove, append_line, free, write_atomically
from bpn_shared.runs.lines import RecordFile
from bpn_shared.runs.lock import OwnershipLostError, RunOwnedError, is_locked, locked
from bpn_shared.runs.lookup import whole_id
from bpn_shared.runs.opening import file_names, folder_names, is_run_id, open_file, read_file
from bpn_shared.runs.ownership import Ownership
from bpn_shared.runs.state import OVER, STATES, RunState, State, decode_state, encode_state
from bpn_shared.runs.warm_start import FILE as INITIAL
from bpn_shared.runs.warm_start import taken_over
from bpn_shared.spec.config import ConfigError, RunConfig

__all__ = [
    "STATES",
    "Ownership",
    "OwnershipLostError",
    "RunFolder",
    "RunOwnedError",
    "RunState",
    "State",
    "is_run_id",
    "run_folders",
]

_WEIGHTS_NAME = re.compile(r"\d{6,}\.bpnw")


class RunFolder:
    """Paths and records of one run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._metrics = RecordFile(path / "metrics.jsonl", root=path.parent)
        self._rewards = RecordFile(path / "rewards.jsonl", root=path.parent)
        self._sealed: bool | None = None

    @classmethod
    def create(cls, runs_dir: Path, run: UUID, config: RunConfig) -> Self:
        """Makes the folder of a new run.

        Raises:
            ConfigError: it begins with another run's weights, and they cannot be had.
            FileExistsError: the run exists.
        """
        initial = b""
        if config.init_from:
            source = cls.open(runs_dir, config.init_from.split(":")[0])
            config, initial = taken_over(config, source)
        folder = cls(runs_dir / str(run))
        folder.path.mkdir(parents=True)
        for part in ("episodes", "weights", "logs"):
            (folder.path / part).mkdir()
        if initial:
            folder.write(INITIAL, initial)
        folder.set_state("queued")
        # Last: a folder that has it counts as a run.
        folder.write("config.json", encode_config(config))
        return folder

    @classmethod
    def open(cls, runs_dir: Path, run: str) -> Self:
        """Opens the folder of a run by its id or the unique beginning or end of it.

        Raises:
            ConfigError: no such run, or several.
        """
        # One that has lost its state is found too: it can go on.
        folders = [cls(runs_dir / name) for name in folder_names(runs_dir) if is_run_id(name)]
        names = [folder.path.name for folder in folders if folder.has("config.json")]
        return cls(runs_dir / whole_id(runs_dir, names, run))

    def is_complete(self) -> bool:
        """Whether this is the folder of a run, and all that makes it one is there.

        A folder that is being made or copied, whatever comes first, is not complete yet; nor is one that is
        named in another spelling of a UUID, which would be the same run twice.
        """
        return is_run_id(self.path.name) and all(map(self.has, ("config.json", "state.json")))

    @property
    def run(self) -> UUID:
        return UUID(self.path.name)

    def open_file(self, name: str) -> BinaryIO:
        """A file of the run, such as "logs/learner.log"; see `opening.open_file`."""
        return open_file(self.path.parent, PurePath(self.path.name, name))

    def read_file(self, name: str) -> bytes:
        """All of a file of the run; see `opening.open_file`."""
        return read_file(self.path.parent, PurePath(self.path.name, name))

    def has(self, name: str) -> bool:
        """Whether the run has a file of that name."""
        try:
            self.open_file(name).close()
        except OSError:
            return False
        return True

    def file_names(self, folder: str = "", *, suffix: str = "") -> list[str]:
        """Names of the files in a folder of the run; see `opening.file_names`."""
        return file_names(self.path.parent, PurePath(self.path.name, folder), suffix=suffix)

    def write(self, name: str, data: bytes, *, prove: Prove = free) -> None:
        """Replaces a file of the run; see `files.write_atomically`."""
        write_atomically(self.path / name, data, root=self.path.parent, prove=prove)

    @property
    def checkpoint_path(self) -> Path:
        return self.path / "checkpoint.safetensors"

    @property
    def logs(self) -> Path:
        return self.path / "logs"

    def config(self) -> RunConfig:
        """The run's configuration.

        Raises:
            OtherConfigVersionError: a version wrote it that this program cannot stand in for.
            ConfigError: the file is missing, damaged, or was changed.
        """
        path = self.path / "config.json"
        try:
            data = self.read_file(path.name)
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}") from error
        return decode_config(data, source=str(path))

    def raw_config(self) -> dict[str, Any]:
        """The configuration's values as they stand in the file, unchecked, for showing; {} if unreadable."""
        return raw_config(self._config_bytes())

    def written_by(self) -> dict[str, Any]:
        """The program that made the run: version, commit, Python, torch, host; {} if it did not say."""
        return config_writer(self._config_bytes())

    def has_sealed_lines(self) -> bool:
        """Whether a line of metrics or rewards without a digest is damaged: since schema 2 all have one."""
        if self._sealed is None:
            data = self._config_bytes()
            if not data:  # not there yet
                return True
            self._sealed = config_schema(data) > 1
        return self._sealed

    def _config_bytes(self) -> bytes:
        try:
            return self.read_file("config.json")
        except OSError:
            return b""

    def state(self) -> RunState:
        """The run's state. Without its file it is "lost", at the highest attempt that other files tell of.

        Raises:
            ConfigError: the file is damaged.
        """
        path = self.path / "state.json"
        try:
            data = self.read_file(path.name)
        except FileNotFoundError:
            return RunState(
                state="lost", attempt=self._attempt_told(), error="state.json is missing"
            )
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}") from error
        return decode_state(data, source=str(path))

    def _attempt_told(self) -> int:
        attempts = [int(record.get("attempt", 0)) for record in self.metrics()]
        with contextlib.suppress(ConfigError, ValueError):
            attempts.append(self.newest_weights().attempt)
        return max(attempts, default=0)

    def set_state(
        self, state: State, *, error: str = "", new_attempt: bool = False, owner: str = ""
    ) -> RunState:
        """Says what the run is doing, for whoever has its lock or nobody has; no learner owns it then.

        Args:
            owner: the learner whose attempt it is from now on.
        """
        attempt = self.state().attempt + new_attempt
        return self.write_state(state, error=error, attempt=attempt, owner=owner)

    def settle(self, state: State, *, error: str = "", by: str) -> RunState:
        """Says how a run ended whose learner cannot say it any more; that it finished or failed stands.

        Args:
            by: who says so, for the message that others get meanwhile.

        Raises:
            RunOwnedError: a learner owns the run.
        """
        with self.owned(by, patience_s=0.0):
            found = self.state()
            if found.state in (*OVER, state):
                return found
            try:
                return self.set_state(state, error=error)
            except OSError as full:
                if full.errno not in (errno.ENOSPC, errno.EDQUOT):
                    raise
            # The old file's room may be all there is; should even that not do, the run is "lost", not "running".
            (self.path / "state.json").unlink(missing_ok=True)
            new = found.model_copy(
                update={"state": state, "error": error, "updated_unix_s": time.time(), "owner": ""}
            )
            self.write("state.json", encode_state(new))
            return new

    def write_state(
        self, state: State, *, error: str = "", attempt: int, owner: str = "", prove: Prove = free
    ) -> RunState:
        """Replaces the state; only for who has made sure that it may."""
        now = time.time()
        new = RunState(
            state=state,
            attempt=attempt,
            created_unix_s=self.state().created_unix_s or now,
            updated_unix_s=now,
            error=error,
            owner=owner,
        )
        self.write("state.json", encode_state(new), prove=prove)
        return new

    @contextlib.contextmanager
    def owned(self, owner: str, patience_s: float = 1.0) -> Iterator[Ownership]:
        """Keeps other learners out, on every machine that shares the folder, while the body runs.

        An owner that has been silent for half a minute, frozen or cut off, is no obstacle.

        Args:
            owner: who asks, for the message that others get.
            patience_s: how long to wait for an owner that is just ending.

        Raises:
            RunOwnedError: another learner owns the run.
            ConfigError: the lock file is none.
        """
        with locked(self._lock_path, owner, patience_s):
            yield Ownership(self, owner)

    def is_owned(self) -> bool:
        """Whether some learner owns the run now.

        Raises:
            ConfigError: the lock file is none.
        """
        return is_locked(self._lock_path)

    @property
    def _lock_path(self) -> Path:
        return self.path / ".lock"

    def episode_path(self, iteration: int, episode: int) -> Path:
        return self.path / "episodes" / f"{iteration:06d}-{episode:05d}.bpne"

    def weights_path(self, version: int) -> Path:
        return self.path / "weights" / f"{version:06d}.bpnw"

    def newest_weights(self) -> Weights:
        """The highest version in the folder, which is at least the last one that metrics tell of.

        Raises:
            ConfigError: there is none yet, or the newest is missing.
            BlobError: the file is damaged.
        """
        names = self.file_names("weights", suffix=".bpnw")
        versions = [int(name[:-5]) for name in names if _WEIGHTS_NAME.fullmatch(name)]
        if not versions:
            raise ConfigError(f"{self.path} holds no weights yet")
        told = max((int(record.get("weights_version", 0)) for record in self.metrics()), default=0)
        if max(versions) < told:
            raise ConfigError(
                f"{self.weights_path(told)} is missing, though metrics.jsonl tells of it: resume the run"
            )
        return self.weights(max(versions))

    def weights(self, version: int) -> Weights:
        """A version of the policy.

        Raises:
            BlobError: the file is damaged.
            OSError: it is missing, or cannot be read.
        """
        return decode_weights(self.read_file(f"weights/{self.weights_path(version).name}"))

    def best(self) -> Best:
        """The best version in the evaluations during training.

        Raises:
            ConfigError: none was evaluated, or the file is damaged.
        """
        path = self.path / "best.json"
        try:
            data = self.read_file(path.name)
        except OSError as error:
            raise ConfigError(
                f"{path}: {error.strerror}; runs with evaluate_every have it after their first evaluation"
            ) from error
        return decode_best(data, source=str(path))

    def append_metrics(self, record: Mapping[str, Any], *, prove: Prove = free) -> None:
        """Adds one iteration's record; it is on disk when this returns."""
        self._append("metrics.jsonl", record, prove)

    def append_rewards(
        self, iteration: int, rewards_px: Sequence[Sequence[float]], *, prove: Prove = free
    ) -> None:
        """Adds the rewards of an iteration's steps, for each of its episodes in order."""
        self._append("rewards.jsonl", {"iteration": iteration, "rewards_px": rewards_px}, prove)

    def _append(self, name: str, record: Mapping[str, Any], prove: Prove) -> None:
        append_line(self.path / name, seal_line(record), root=self.path.parent, prove=prove)

    def metrics(self) -> list[dict[str, Any]]:
        """The iterations' records in order, each iteration once; damaged lines are left out, and told once.

        Raises:
            ConfigError: the file cannot be read.
        """
        return self._read(self._metrics)

    def rewards(self) -> dict[int, list[list[float]]]:
        """The rewards of every step of each iteration's episodes, in pixels, as far as they are kept.

        Raises:
            ConfigError: the file cannot be read.
        """
        return {record["iteration"]: record["rewards_px"] for record in self._read(self._rewards)}

    def _read(self, file: RecordFile) -> list[dict[str, Any]]:
        try:
            return file.read(sealed=self.has_sealed_lines())
        except OSError as error:
            raise ConfigError(f"{self.path}: {error}") from error


def run_folders(runs_dir: Path) -> Iterator[RunFolder]:
    """The complete run folders in a directory, oldest first: their names sort by time."""
    for name in folder_names(runs_dir):
        folder = RunFolder(runs_dir / name)
        if folder.is_complete():
            yield folder
