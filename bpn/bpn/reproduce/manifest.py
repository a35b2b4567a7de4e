"""Which run of a folder has which configuration, so that no run is made twice."""

import fcntl
import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from bpn.local_run import new_run
from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import OPTIONS, ConfigError, RunConfig

_SCHEMA = 2


def config_hash(config: RunConfig) -> str:
    """Names a configuration by what it changes of its task's bare one, so that a new field changes no name."""
    bare = RunConfig.bare(config.task, actions=config.actions)
    values = {name: getattr(config, name) for name in OPTIONS}
    changes = {name: value for name, value in values.items() if value != getattr(bare, name)}
    return digest(changes | {"task": config.task, "actions": config.actions})


def digest(values: dict[str, Any]) -> str:
    """Sixteen hex digits of the SHA-256 of these JSON values, whatever their order."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


class Manifest:
    """`manifest.json` in a folder of runs: configuration hash to run id.

    Raises:
        ConfigError: the file is damaged.
    """

    def __init__(self, runs_dir: Path) -> None:
        self._runs_dir, self._path = runs_dir, runs_dir / "manifest.json"
        self._runs: dict[str, str] = {}
        if self._path.exists():
            try:
                found = dict(json.loads(self._path.read_bytes()))
                runs = found if "schema" not in found else found["runs"]
                self._runs = {str(name): str(run) for name, run in runs.items()}
            except (ValueError, KeyError, AttributeError) as error:
                raise ConfigError(
                    f"{self._path}: {error}; remove it to make its runs anew"
                ) from error
            if "schema" not in found:
                self._runs = dict(self._named_anew())

    def folder(self, config: RunConfig) -> RunFolder:
        """The run with this configuration, made if there is none."""
        name = config_hash(config)
        known = self._known(name, config)
        if known is not None:
            return known
        folder = new_run(self._runs_dir, config)
        self._runs[name] = str(folder.run)
        document = {"schema": _SCHEMA, "runs": self._runs}
        write_atomically(self._path, json.dumps(document, indent=1).encode())
        return folder

    def _named_anew(self) -> Iterator[tuple[str, str]]:
        """The runs of a manifest of schema 1, whose names were of values that are called otherwise today."""
        for run in self._runs.values():
            with suppress(ConfigError, OSError):  # which somebody removed, or damaged
                yield config_hash(RunFolder(self._runs_dir / run).config()), run

    def _known(self, name: str, config: RunConfig) -> RunFolder | None:
        if name not in self._runs:
            return None
        folder = RunFolder(self._runs_dir / self._runs[name])
        if not (folder.path / "config.json").exists():
            return None  # somebody removed it
        return folder if folder.config() == config else None  # a default has changed since


@contextmanager
def locked(runs_dir: Path) -> Iterator[None]:
    """Keeps other campaigns out of the folder.

    Raises:
        ConfigError: there is one already.
    """
    runs_dir.mkdir(parents=True, exist_ok=True)
    with (runs_dir / "manifest.lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(
                f"another `bpn reproduce` works in {runs_dir}: wait for it, or choose another --runs-dir"
            ) from None
        yield
