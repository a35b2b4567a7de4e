"""The packages in `examples/`, installed from their folders as a user would, into a folder of packages."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

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
    paths = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
