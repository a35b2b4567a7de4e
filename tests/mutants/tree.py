"""A throw-away copy of the code, in which something is changed and tests are run."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

ROOT = Path(__file__).parents[2]
PACKAGES = (
    "shared", "services/edge", "services/learner", "services/robot", "services/robot_sim", "services/dashboard",
    "deploy/certificates", "bpn",
)  # fmt: skip
_LEFT_OUT = shutil.ignore_patterns(
    "node_modules", "__pycache__", ".hypothesis", "web", "build", "results", "*.png", "*.egg-info"
)

Outcome = Literal["passed", "failed", "timeout"]


class Tree:
    """The copy.

    Attributes:
        path: its root.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        for name in (*PACKAGES, "tests", "deploy", "docs", "bench"):
            shutil.copytree(ROOT / name, path / name, ignore=_LEFT_OUT, dirs_exist_ok=True)
        shutil.copy(ROOT / "pyproject.toml", path)

    @contextlib.contextmanager
    def changed(self, file: str, source: str) -> Iterator[None]:
        """The file with other contents while the body runs."""
        path = self.path / file
        original = path.read_text()
        path.write_text(source)
        try:
            yield
        finally:
            path.write_text(original)

    def pytest(self, tests: Sequence[str], timeout_s: float) -> tuple[Outcome, str]:
        """Whether these tests pass here, and the name of the first that does not."""
        command = ["-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
        outcome, output = self.python(command, timeout_s)
        failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
        return outcome, failed[0] if failed else outcome

    def python(self, arguments: Sequence[str], timeout_s: float) -> tuple[Outcome, str]:
        """Runs Python on the copy's code; what it prints."""
        process = subprocess.Popen(
            [sys.executable, *arguments],
            cwd=self.path,
            env=os.environ | self._environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            return "timeout", ""
        finally:
            with contextlib.suppress(ProcessLookupError):  # what it has left behind, too
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        return ("passed" if process.returncode == 0 else "failed"), output

    def _environment(self) -> dict[str, str]:
        # the same examples every time; and no bytecode, which might be an earlier change's
        return {
            "PYTHONPATH": os.pathsep.join(str(self.path / name) for name in PACKAGES),
            "PYTHONDONTWRITEBYTECODE": "1",
            "CI": "1",
        }


@contextlib.contextmanager
def tree() -> Iterator[Tree]:
    """A copy that is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="bpn-mutants-") as path:
        yield Tree(Path(path))
