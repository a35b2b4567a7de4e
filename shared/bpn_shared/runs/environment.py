"""environment.jsonl: where and with what each attempt of a run was made, a line for each, in order."""

import logging
import os
import platform
import sys
import time
from collections.abc import Callable
from importlib.metadata import distributions
from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from bpn_shared.runs.digests import DamagedError, seal_line, unseal_line
from bpn_shared.runs.files import append_line
from bpn_shared.version import VERSION, commit, has_uncommitted_changes

if TYPE_CHECKING:
    from bpn_shared.runs.folder import RunFolder

log = logging.getLogger(__name__)

FILE = "environment.jsonl"
MOST = 1000
"""Of the newest attempts that are read."""


class Environment(BaseModel):
    """Of one attempt; None where it is not known.

    Attributes:
        worker: the learner that owned the run.
        command: the arguments of its process.
        commit: of this program, where it ran from a checkout or its image said so.
        uncommitted: whether the checkout had changes that no commit has.
        packages: every installed package with its version.
        accelerator: the GPU that torch found; empty: none.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    attempt: int
    worker: str
    time_unix_s: float
    host: str = ""
    command: list[str] = []
    version: str = ""
    commit: str | None = None
    uncommitted: bool | None = None
    python: str = ""
    system: str = ""
    cores: int | None = None
    memory_bytes: int | None = None
    accelerator: str = ""
    packages: dict[str, str] = {}

    @classmethod
    def here(cls, attempt: int, worker: str, accelerator: str = "") -> Self:
        """Of an attempt that this process begins now."""
        found = ((one.metadata["Name"], one.version) for one in distributions())
        return cls(
            attempt=attempt,
            worker=worker,
            time_unix_s=time.time(),
            host=platform.node(),
            command=list(sys.orig_argv),
            version=VERSION,
            commit=commit(),
            uncommitted=has_uncommitted_changes(),
            python=platform.python_version(),
            system=platform.platform(),
            cores=os.cpu_count(),
            memory_bytes=os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
            accelerator=accelerator,
            packages={name: version for name, version in sorted(found) if name},
        )


def write_environment(
    folder: "RunFolder", environment: Environment, *, prove: Callable[[], None]
) -> None:
    """Adds an attempt's.

    Raises:
        OSError: it cannot be written.
        OwnershipLostError: as `prove` does.
    """
    line = seal_line(environment.model_dump(mode="json"))
    append_line(folder.path / FILE, line, root=folder.path.parent, prove=prove)


def read_environments(folder: "RunFolder") -> list[Environment]:
    """What the run's attempts wrote, oldest first; damaged lines are left out.

    Raises:
        OSError: the file cannot be read.
    """
    try:
        lines = folder.read_file(FILE).splitlines()[-MOST:]
    except FileNotFoundError:  # of a version before
        return []
    return [one for line in lines if (one := _decoded(line)) is not None]


def _decoded(line: bytes) -> Environment | None:
    try:
        values: dict[str, Any] = unseal_line(line)[0]
        return Environment.model_validate(values)
    except (DamagedError, ValidationError) as error:
        log.debug("a line of %s is left out: %s", FILE, error)
        return None
