"""The packages in `examples/`, installed from their folders as a user would, into a folder of packages."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[2] / "examples"
ALL = tuple(sorted(path.parent.name for path in EXAMPLES.glob("*/pyproject.toml")))


def install_examples(site: Path, *names: str) -> dict[str, str]:
    """Installs them without what they depend on, which is here.

    Returns:
        The environment of processes that find them.
    """
    with tempfile.TemporaryDirectory() as folder:
        sources = []
        for name in names:  # a build leaves things behind
            sources.append(Path(shutil.copytree(EXAMPLES / name, Path(folder) / name)))
        subprocess.run(
            [
                sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps",
                "--no-build-isolation", "--target", site, *sources,
            ],
            check=True, timeout=240,
        )  # fmt: skip
    return where_installed(site)


def where_installed(site: Path) -> dict[str, str]:
    """The environment of processes that find what is in that folder of packages."""
    paths = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}


def train_with(
    environment: dict[str, str], command: Callable[..., list[str]], runs_dir: Path, *arguments: str
) -> dict[str, Any]:
    """What `bpn train --json` says there, and `runs_dir`."""
    done = subprocess.run(
        command("train", *arguments, "--json", "--runs-dir", str(runs_dir)),
        env=environment, capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout) | {"runs_dir": runs_dir}
