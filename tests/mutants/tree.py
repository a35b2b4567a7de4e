"""A throw-away copy of the code, in which something is changed and tests are run."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

ROOT = Path(__file__).parents[2]
_LEFT_OUT = shutil.ignore_patterns(".*", "node_modules", "__pycache__", "*.png", "*.egg-info")
_LEFT_OUT_OF_ROOT = {"build", "runs"}
_DEADLINE = re.compile(r"waited \d+ s for|no episode was delivered|no frame \d|Timeout|timed out")
LIBRARIES = (
    "_hypothesis_pytestplugin", "_pytest.junitxml", "_pytest.pytester", "alembic.command",
    "anyio.pytest_plugin", "cv2", "fastapi.testclient", "gymnasium", "httpx", "msgpack", "onnx",
    "onnxruntime", "prometheus_client", "psutil", "pyarrow", "pydantic", "pytest_timeout", "requests",
    "rich.console", "safetensors.torch", "schemathesis.pytest.plugin", "scipy.stats", "sqlalchemy.orm",
    "sqlalchemy.dialects.sqlite", "sympy", "torch", "uvicorn", "websockets", "zenoh",
)  # fmt: skip
"""Loaded before any test; not MuJoCo, which robots have to prepare for."""
_PASSED, _FAILED, _COLLECTED_BADLY = 0, 1, 2
_NOT_IMPORTED = "Error while loading conftest"
_UNBOUNDED_S = 1e6
_SITECUSTOMIZE = """
# What is installed as editable, with compiled code, is found before PYTHONPATH: not here.
import sys
sys.meta_path[:] = [f for f in sys.meta_path if not type(f).__module__.startswith("_editable_")]
"""

Outcome = Literal["passed", "failed", "deadline", "timeout", "endless"]
"""deadline: a test failed since what it waited for did not happen in time; timeout: the tests did not end in time;
endless: they took far more of the processor than they may."""


class Done(NamedTuple):
    """What became of a run of tests: its outcome, the first test that failed, seconds of the processor."""

    outcome: Outcome
    by: str = ""
    cpu_s: float = 0.0


class Tree:
    """The copy.

    Args:
        source: what is copied.
        libraries: that are loaded before tests are.

    Attributes:
        path: its root.
    """

    def __init__(
        self, path: Path, source: Path = ROOT, libraries: Sequence[str] = LIBRARIES
    ) -> None:
        self.path, self._libraries = path, libraries
        shutil.copytree(source, path, ignore=_ignored, dirs_exist_ok=True)
        (path / "sitecustomize.py").write_text(_SITECUSTOMIZE)
        self._warm: subprocess.Popen[str] | None = None

    def close(self) -> None:
        """Ends the process that runs the tests."""
        if self._warm is not None:
            self._warm.communicate()

    @contextlib.contextmanager
    def changed(self, file: str, source: str) -> Iterator[None]:
        """The file with other contents while the body runs."""
        path = self.path / file
        original = path.read_text()
        path.write_text(source)
        _forget_bytecode(path)
        try:
            yield
        finally:
            path.write_text(original)
            _forget_bytecode(path)

    def pytest(
        self, tests: Sequence[str], timeout_s: float, *options: str, cpu_s: float = _UNBOUNDED_S
    ) -> Done:
        """Runs these tests up to the first that fails.

        Args:
            cpu_s: of the processor that they may take, which does not depend on what else the machine does.

        Raises:
            RuntimeError: pytest itself fails.
        """
        output = self.path / "pytest.txt"
        plugins = ["-p", "no:cacheprovider", "-p", "tests.mutants.pytest_order"]
        arguments = ["-x", "-q", "--tb=short", *plugins, *options, *tests]
        status, used_s = self._run([arguments, str(output), timeout_s, cpu_s])
        if status is None:
            return Done("timeout")
        if status in (-signal.SIGXCPU, -signal.SIGKILL):
            return Done("endless")
        if status == _PASSED:
            return Done("passed", cpu_s=used_s)
        said = output.read_text()
        fails = status in (_FAILED, _COLLECTED_BADLY) or status < 0 or _NOT_IMPORTED in said
        if not fails:
            raise RuntimeError(said)
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)(.*)", said, re.MULTILINE)
        by, reason = failed.groups() if failed else ("", said[-500:])
        return Done("deadline" if _DEADLINE.search(reason) else "failed", by)

    def python(self, arguments: Sequence[str], timeout_s: float) -> tuple[int | None, str]:
        """Runs Python on the copy's code; its exit status (None: it did not end), and what it prints."""
        process = subprocess.Popen(
            [sys.executable, *arguments],
            cwd=self.path, env=self._environment(), text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            output, _ = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            return None, ""
        finally:
            with contextlib.suppress(ProcessLookupError):  # what it has left behind, too
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        return process.returncode, output

    def _run(self, request: list[object]) -> tuple[int | None, float]:
        if self._warm is None:
            self._warm = subprocess.Popen(
                [sys.executable, "-m", "tests.mutants.warm", *self._libraries],
                cwd=self.path, env=self._environment(), text=True,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            )  # fmt: skip
        assert self._warm.stdin is not None
        assert self._warm.stdout is not None
        self._warm.stdin.write(json.dumps(request) + "\n")
        self._warm.stdin.flush()
        status, cpu_s = json.loads(self._warm.stdout.readline())
        return status, cpu_s

    def _environment(self) -> dict[str, str]:
        # the same examples every time, and no longer waits than an idle machine needs
        roots = os.pathsep.join(str(self.path / root) for root in package_roots())
        return os.environ | {"PYTHONPATH": roots, "CI": "1", "BPN_TEST_DEADLINE_S": "20"}


def package_roots() -> list[str]:
    """The folders that packages are imported from, and the root, which tests are."""
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())
    return [*told["tool"]["mypy"]["mypy_path"].split(":"), "."]


def _ignored(folder: str, names: list[str]) -> set[str]:
    return _LEFT_OUT(folder, names) | (_LEFT_OUT_OF_ROOT if Path(folder) == ROOT else set())


def _forget_bytecode(path: Path) -> None:
    """Python tells sources by size and second, which two changes may share."""
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


@contextlib.contextmanager
def tree() -> Iterator[Tree]:
    """A copy that is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="bpn-mutants-") as path:
        copy = Tree(Path(path))
        try:
            yield copy
        finally:
            copy.close()
