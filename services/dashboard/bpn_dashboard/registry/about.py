"""What people say about a run, and what they want of it: `about.json` beside the run's own files.

The database has the same; this copy lets it be rebuilt. The registry alone writes it.
"""

import contextlib
import json
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field

from bpn_dashboard.database.tables import RunRow, SweepRow
from bpn_dashboard.registry.states import DesiredState
from bpn_shared.runs.digests import DamagedError, seal, unseal
from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.opening import read_file
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.renamed import renamed, renamed_grid

_FILE = "about.json"
SWEEPS = "sweeps"
"""Folder of the sweeps' files, beside the run folders."""
_REMEDY = (
    "restore it; or remove the line of its sha256 to take it as it is, or the file to forget it"
)


class _Mirror(BaseModel):
    """A row as a file."""

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Reads what `write` wrote, and files without a digest, of before there was one.

        Raises:
            DamagedError, ValidationError: damaged.
        """
        return cls.model_validate_json(json.dumps(unseal(data)[0]))


class About(_Mirror):
    """The mirrored columns of `RunRow`. What another version wrote beside them stays in the file."""

    model_config = ConfigDict(frozen=True, extra="ignore", from_attributes=True)

    name: str = ""
    notes: str = ""
    tags: list[str] = []
    sweep_id: str | None = None
    archived_at: float | None = None
    desired_state: DesiredState = "stopped"
    """A run that another program made is not ours to start."""
    priority: Annotated[int, Field(ge=-(2**31), lt=2**31)] = 0
    rev: Annotated[int, Field(ge=1)] = 1

    @classmethod
    def read(cls, folder: RunFolder) -> Self:
        """What is said about a run; the defaults if nobody said anything.

        Raises:
            ConfigError: the file is damaged.
        """
        try:
            return cls.decode(folder.read_file(_FILE))
        except FileNotFoundError:
            return cls()
        except (OSError, ValueError) as error:
            raise ConfigError(f"{folder.path / _FILE}: {error}; {_REMEDY}") from error

    def columns(self) -> dict[str, Any]:
        """The columns but for the name, which may be left to be made up."""
        return self.model_dump(exclude={"name"})

    @classmethod
    def write(cls, folder: RunFolder, row: RunRow) -> None:
        """Mirrors the row."""
        about = cls.model_validate(row).model_dump()
        with contextlib.suppress(OSError, DamagedError):
            about = unseal(folder.read_file(_FILE))[0] | about
        folder.write(_FILE, seal(about))


class SweepFile(_Mirror):
    """A sweep's row as a file."""

    model_config = ConfigDict(frozen=True, extra="forbid", from_attributes=True)

    id: str
    name: str
    config: dict[str, Any]
    grid: dict[str, list[Any]]
    seeds: list[int]
    created_at: float

    @classmethod
    def write(cls, runs_dir: Path, row: SweepRow) -> None:
        """Mirrors the row."""
        path = cls.path(runs_dir, row.id)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, seal(cls.model_validate(row).model_dump(mode="json")), root=runs_dir)

    @staticmethod
    def path(runs_dir: Path, sweep_id: str) -> Path:
        """Of a sweep's file."""
        return runs_dir / SWEEPS / f"{sweep_id}.json"

    @classmethod
    def read(cls, runs_dir: Path, name: str) -> SweepRow:
        """The row that a file of that name, in the folder of the sweeps, mirrors.

        Raises:
            ConfigError: the file is damaged.
        """
        try:
            sweep = cls.decode(read_file(runs_dir, f"{SWEEPS}/{name}"))
            return SweepRow(**sweep.model_dump())
        except (OSError, ValueError) as error:
            raise ConfigError(f"{runs_dir / SWEEPS / name}: {error}; {_REMEDY}") from error

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """As every mirror's; values that had another name then have today's."""
        sweep = super().decode(data)
        today = {"config": renamed(sweep.config), "grid": renamed_grid(sweep.grid)}
        return sweep.model_copy(update=today)
