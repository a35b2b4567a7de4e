"""The open tools for FPGAs: those of `pip install 'bpn[fpga]'`, which figures are of, else the system's."""

import os
import re
import shutil
import subprocess
import sysconfig
import time
from pathlib import Path

from bpn.errors import CommandError
from bpn_shared.errors import InputError


class MissingToolError(InputError):
    """A tool is not installed."""


def find(name: str) -> str:
    """Where a tool such as yosys is.

    Raises:
        MissingToolError: it is not installed; the message says how it is.
    """
    beside = Path(sysconfig.get_path("scripts"))
    for place in (beside / f"yowasp-{name}", beside / name):
        if place.exists():
            return str(place)
    found = shutil.which(f"yowasp-{name}") or shutil.which(name)
    if found is None:
        raise MissingToolError(f"{name} is not installed: pip install 'bpn[fpga]'")
    return found


def version(name: str) -> str:
    """What a tool says of its version, such as `Yosys 0.23`."""
    said = subprocess.run([find(name), "--version"], capture_output=True, text=True, check=False)  # noqa: S603 - a tool that was found
    found = re.search(r"(\d+\.\d+[\w.+-]*)", said.stdout + said.stderr)
    return f"{name} {found.group(1) if found else 'unknown'}"


def run(name: str, arguments: list[str], *, where: Path, log: str) -> float:
    """Runs a tool in a folder, with what it says in a file there.

    Returns:
        Seconds that it took.

    Raises:
        MissingToolError: it is not installed.
        CommandError: it fails; the message has its last error, and names the file.
    """
    began_s = time.monotonic()
    path = where / log
    with path.open("w") as said:
        done = subprocess.run(  # noqa: S603 - a tool that was found
            [find(name), *arguments],
            cwd=where,
            stdout=said,
            stderr=subprocess.STDOUT,
            check=False,
            env=os.environ,
        )
    if done.returncode:
        errors = [
            line
            for line in path.read_text(errors="replace").splitlines()
            if "ERROR" in line.upper()
        ]
        raise CommandError(
            f"{name} failed: {errors[-1] if errors else f'exit status {done.returncode}'}; see {path}"
        )
    return time.monotonic() - began_s
