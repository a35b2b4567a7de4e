"""Which program this is, and which protocol it speaks."""

import os
import platform
import shutil
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

VERSION: Final = version("bpn-shared")
PROTOCOL: Final = 4
"""Of everything that travels between services. It rises when services of before and after cannot work together:
the registry gives no place to a worker with another one, and says so."""

COMMIT = "BPN_COMMIT"
"""Environment variable: the commit that an image was built from."""


def written_by() -> dict[str, str | None]:
    """Who writes a file: version and commit of this program, and what it runs on; None where it is not known."""
    return {
        "version": VERSION,
        "commit": commit(),
        "python": platform.python_version(),
        "torch": _torch_version(),
        "host": platform.node(),
    }


def describe() -> str:
    """Version and protocol, and the commit where it is known, in one line."""
    known = commit()
    return f"{VERSION}, protocol {PROTOCOL}" + (f", commit {known}" if known else "")


@cache
def commit() -> str | None:
    """The commit of this program, where it runs from a checkout or its image says so."""
    return os.environ.get(COMMIT) or _git("rev-parse", "HEAD") or None


@cache
def has_uncommitted_changes() -> bool | None:
    """Whether this program's checkout has changes that no commit has; None where that is not known."""
    if os.environ.get(COMMIT):
        return None
    changes = _git("status", "--porcelain", "--untracked-files=no")
    return None if changes is None else bool(changes)


def _git(*arguments: str) -> str | None:
    """What git says of this program's checkout; None where there is no git, or no checkout."""
    root, git = Path(__file__).parents[2], shutil.which("git")
    if git is None or not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(  # noqa: S603 - fixed arguments
            [git, "-C", str(root), *arguments],
            capture_output=True,
            text=True,
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _torch_version() -> str | None:
    try:
        return version("torch")
    except PackageNotFoundError:
        return None
