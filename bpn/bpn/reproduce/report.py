"""A target's files in docs/results: JSON with everything, a plot, and a table."""

import json
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bpn.bench.machine import machine, versions
from bpn.plotting import save
from bpn.reproduce.caption import QUICK
from bpn.reproduce.definition import Document, Target
from bpn.reproduce.record import run_record
from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.folder import RunFolder


def document(
    target: Target, command: str, runs: Sequence[RunFolder], result: dict[str, Any], *, quick: bool
) -> Document:
    """Everything that the plot and the table are made of.

    Returns:
        target, title, command, quick, made_unix_s, commit (None outside a git checkout), versions, machine,
        runs (see `record.run_record`), result (see the target's `measure`).
    """
    return {
        "target": target.name,
        "title": target.title,
        "command": command,
        "quick": quick,
        "made_unix_s": round(time.time()),
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
        "runs": [run_record(folder) for folder in runs],
        "result": result,
    }


def write(target: Target, made: Document, out: Path) -> list[Path]:
    """Writes <target>.json, .png and .md; in this order, so that a failing plot loses no numbers."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{target.name}.json"
    write_atomically(path, to_json(made).encode())
    return [path, *draw(target, made, out)]


def draw(target: Target, made: Document, out: Path) -> list[Path]:
    """Writes <target>.png and .md."""
    paths = [out / f"{target.name}.{suffix}" for suffix in ("png", "md")]
    save(target.draw(made), paths[0])
    write_atomically(paths[1], page(target, made).encode())
    return paths


def page(target: Target, made: Document) -> str:
    """The markdown file."""
    when = time.strftime("%Y-%m-%d", time.gmtime(made["made_unix_s"]))
    warning = f"**{QUICK}.**\n\n" if made["quick"] else ""
    return (
        f"# {target.title}\n\n{warning}![{target.title}]({target.name}.png)\n\n{target.table(made)}\n\n"
        f"Made by `{made['command']}` on {when}, {made['machine']['cpu']}, {made['machine']['cores']} cores, "
        f"commit {(made['commit'] or 'unknown')[:12]}. Raw numbers: [{target.name}.json]({target.name}.json).\n"
    )


def to_json(made: Document) -> str:
    """JSON with a line for each run, so that differences can be read."""
    parts = []
    for key, value in made.items():
        if isinstance(value, list):
            lines = ",\n".join(f"  {json.dumps(item, allow_nan=False)}" for item in value)
            parts.append(f' "{key}": [\n{lines}\n ]' if value else f' "{key}": []')
        else:
            parts.append(f' "{key}": {json.dumps(value, allow_nan=False)}')
    return "{\n" + ",\n".join(parts) + "\n}\n"


def commit() -> str | None:
    """The checkout's commit, with "-dirty" where files differ from it."""
    git = shutil.which("git")
    if git is None:
        return None
    done = subprocess.run(  # noqa: S603 - fixed arguments
        [git, "-C", str(Path(__file__).parent), "describe", "--always", "--abbrev=40", "--dirty"],
        capture_output=True,
        text=True,
        timeout=10,
        check=False,
    )
    return done.stdout.strip() or None
