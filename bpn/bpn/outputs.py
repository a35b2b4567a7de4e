"""Where commands write: that it can be written is known before the work whose results it takes."""

import os
import tempfile
from pathlib import Path

from bpn_shared.errors import InputError


def check_runs_dir(path: Path) -> None:
    """Makes the folder if it is not there, and tries that files can be written into it.

    Raises:
        InputError: it cannot be made or written; the message says why.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        check_writable(path)
    except OSError as error:
        raise InputError(
            f"--runs-dir {path}: {_reason(error)}; choose a folder that you may write"
        ) from error


def check_output(option: str, path: Path, suffixes: tuple[str, ...]) -> None:
    """Tries that a file can be written where an option says, before the work whose result it takes.

    Args:
        suffixes: of formats that it may have.

    Raises:
        InputError: it cannot; the message says why.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{option} {path}: the name must end with one of {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise InputError(f"{option} {path}: there is no folder {path.parent}; make it first")
    try:
        if path.exists():
            os.close(os.open(path, os.O_WRONLY))
        else:
            check_writable(path.parent)
    except OSError as error:
        raise InputError(f"{option} {path}: {_reason(error)}") from error


def check_writable(folder: Path) -> None:
    """Writes a file into the folder that is gone afterwards.

    Raises:
        OSError: that is not possible.
    """
    with tempfile.TemporaryFile(dir=folder, prefix=".bpn-") as file:
        file.write(b"\0")


def _reason(error: OSError) -> str:
    return str(error.strerror or error)
