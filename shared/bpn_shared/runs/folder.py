"""The run folder: the truth about a run. One process writes it (its learner); anyone may read.

    config.json         the configuration, never changed
    state.json          state, attempt, when, and why it failed
    metrics.jsonl       one line per iteration; after a crash an iteration may stand twice, the later counts
    rewards.jsonl       likewise: the rewards of every step of its episodes, in pixels
    episodes/           every episode as it was delivered, <iteration>-<episode>.bpne
    weights/            every weights version, <version>.bpnw
    checkpoint.safetensors
    logs/               what each service said

Files that are replaced are replaced atomically; what was acknowledged to others is on disk first.
"""

import contextlib
import fcntl
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Annotated, Any, BinaryIO, Literal, Self
from uuid import UUID

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bpn_shared.config import ConfigError, RunConfig
from bpn_shared.runs.files import append_line, write_atomically
from bpn_shared.runs.opening import file_names, open_file, read_file
from bpn_shared.weights import Weights, decode_weights

State = Literal["queued", "running", "stopping", "finished", "failed", "stopped", "lost"]


class RunState(BaseModel):
    """What a run is doing, and how many learners have owned it (`attempt`)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    state: State = "queued"
    attempt: Annotated[int, Field(ge=0)] = 0
    created_unix_s: float = 0.0
    updated_unix_s: float = 0.0
    error: str = ""


class RunOwnedError(RuntimeError):
    """Another learner works on the run; the message says which."""


class RunFolder:
    """Paths and records of one run."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, runs_dir: Path, run: UUID, config: RunConfig) -> Self:
        """Makes the folder of a new run.

        Raises:
            FileExistsError: the run exists.
        """
        folder = cls(runs_dir / str(run))
        folder.path.mkdir(parents=True)
        for part in ("episodes", "weights", "logs"):
            (folder.path / part).mkdir()
        folder.set_state("queued")
        # Last: a folder that has it counts as a run.
        folder.write("config.json", config.model_dump_json(indent=2).encode())
        return folder

    @classmethod
    def open(cls, runs_dir: Path, run: str) -> Self:
        """Opens the folder of a run by its id or the unique beginning or end of it.

        Raises:
            ConfigError: no such run, or several.
        """
        names = [folder.path.name for folder in run_folders(runs_dir)]
        matches = [name for name in names if name.startswith(run) or name.endswith(run)]
        if len(matches) != 1:
            found = "no run" if not matches else f"{len(matches)} runs"
            raise ConfigError(
                f"{found} in {runs_dir} match {run!r}; there are: {names[-5:] or 'none'}"
            )
        return cls(runs_dir / matches[0])

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

    def write(self, name: str, data: bytes) -> None:
        """Replaces a file of the run; see `files.write_atomically`."""
        write_atomically(self.path / name, data, root=self.path.parent)

    @property
    def checkpoint_path(self) -> Path:
        return self.path / "checkpoint.safetensors"

    @property
    def logs(self) -> Path:
        return self.path / "logs"

    def config(self) -> RunConfig:
        """The run's configuration.

        Raises:
            ConfigError: the file is missing or wrong.
        """
        path = self.path / "config.json"
        try:
            return RunConfig.from_json(self.read_file(path.name), source=str(path))
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}") from error

    def state(self) -> RunState:
        """The run's state.

        Raises:
            ConfigError: the file is missing or wrong.
        """
        path = self.path / "state.json"
        try:
            return RunState.model_validate_json(self.read_file(path.name))
        except (OSError, ValidationError) as error:
            raise ConfigError(f"{path}: {error}") from error

    def set_state(self, state: State, *, error: str = "", new_attempt: bool = False) -> RunState:
        now = time.time()
        old = self.state() if self.has("state.json") else RunState(created_unix_s=now)
        new = RunState(
            state=state,
            attempt=old.attempt + new_attempt,
            created_unix_s=old.created_unix_s,
            updated_unix_s=now,
            error=error,
        )
        self.write("state.json", new.model_dump_json(indent=2).encode())
        return new

    @contextlib.contextmanager
    def owned(self, owner: str, patience_s: float = 1.0) -> Iterator[None]:
        """Keeps other learners out, on every machine that shares the folder, while the body runs.

        Args:
            owner: who asks, for the message that others get.
            patience_s: how long to wait for an owner that is just ending.

        Raises:
            RunOwnedError: another learner owns the run.
        """
        deadline_s = time.monotonic() + patience_s
        with self._lock_path.open("a+") as file:
            while not _lock(file.fileno(), fcntl.LOCK_EX):
                if time.monotonic() > deadline_s:
                    file.seek(0)
                    raise RunOwnedError(
                        f"run {self.run} is being learned by {file.read() or 'another learner'}: "
                        "wait for its end or stop it there"
                    )
                time.sleep(0.05)
            file.truncate(0)
            file.write(owner)
            file.flush()
            yield

    def is_owned(self) -> bool:
        """Whether some learner owns the run now."""
        try:
            with self.open_file(self._lock_path.name) as file:
                return not _lock(file.fileno(), fcntl.LOCK_SH)
        except OSError:
            return False

    @property
    def _lock_path(self) -> Path:
        return self.path / ".lock"

    def episode_path(self, iteration: int, episode: int) -> Path:
        return self.path / "episodes" / f"{iteration:06d}-{episode:05d}.bpne"

    def weights_path(self, version: int) -> Path:
        return self.path / "weights" / f"{version:06d}.bpnw"

    def newest_weights(self) -> Weights:
        """The highest version in the folder.

        Raises:
            ConfigError: there is none yet.
            BlobError: the file is damaged.
        """
        names = self.file_names("weights", suffix=".bpnw")
        if not names:
            raise ConfigError(f"{self.path} holds no weights yet")
        return decode_weights(self.read_file(f"weights/{names[-1]}"))

    def append_metrics(self, record: Mapping[str, Any]) -> None:
        """Adds one iteration's record; it is on disk when this returns."""
        append_line(self.path / "metrics.jsonl", record)

    def append_rewards(self, iteration: int, rewards_px: Sequence[Sequence[float]]) -> None:
        """Adds the rewards of an iteration's steps, for each of its episodes in order."""
        append_line(self.path / "rewards.jsonl", {"iteration": iteration, "rewards_px": rewards_px})

    def metrics(self) -> list[dict[str, Any]]:
        """The iterations' records in order, each iteration once; a line cut by a crash is left out."""
        records: dict[int, dict[str, Any]] = {}
        data = self.read_file("metrics.jsonl") if self.has("metrics.jsonl") else b""
        for line in data.decode().splitlines():
            try:
                record = json.loads(line)
            except json.JSONDecodeError:
                continue
            records[record["iteration"]] = record
        return [records[iteration] for iteration in sorted(records)]


def run_folders(runs_dir: Path) -> Iterator[RunFolder]:
    """The complete run folders in a directory, oldest first: their names sort by time."""
    for path in sorted(runs_dir.iterdir()) if runs_dir.is_dir() else ():
        folder = RunFolder(path)
        if not path.is_symlink() and folder.is_complete():
            yield folder


def is_run_id(name: str) -> bool:
    """Whether a name is a run's id, in the one spelling that counts."""
    try:
        return str(UUID(name)) == name
    except ValueError:
        return False


def _lock(descriptor: int, kind: int) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
