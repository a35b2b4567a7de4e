"""The examples, installed by pip: their entry points are found, and do what their pages say."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn.testing import check_kernel
from bpn_edge.kernel import load
from bpn_shared.runs.folder import RunFolder

EXAMPLES = Path(__file__).parents[3] / "examples"
SMALL = [
    "reaching",
    "--iterations",
    "2",
    "--episodes",
    "2",
    "--epochs",
    "1",
    "--hidden-units",
    "8",
    "--batch-size",
    "8",
]


def installed(site: Path, name: str) -> None:
    """One example, in a folder of packages, by pip."""
    built = site.with_name(f"{name}-source")  # a build leaves files where it is done
    shutil.copytree(EXAMPLES / name, built)
    subprocess.run(
        [
            sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps",
            "--no-index", "--no-build-isolation", "--target", site, built,
        ],
        check=True, timeout=60,
    )  # fmt: skip


def test_the_kernel_passes_the_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = tmp_path / "site"
    installed(site, "own_kernel")
    monkeypatch.syspath_prepend(site)
    check_kernel(load("blas"), networks=20)


def test_callback_and_kernel_train_by_command_line_to_the_same_weights(
    tmp_path: Path, command: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site"
    for name in ("own_callback", "own_kernel"):
        installed(site, name)
    runs: dict[str, RunFolder] = {}
    for which, options in (("plain", []), ("own", ["--kernel", "blas", "--callbacks", "gap"])):
        if options:
            monkeypatch.setenv("PYTHONPATH", str(site))
        subprocess.run(
            command("train", *SMALL, *options, "--runs-dir", str(tmp_path / which)),
            check=True, timeout=90, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        (path,) = (path.parent for path in (tmp_path / which).glob("*/config.json"))
        runs[which] = RunFolder(path)
    plain, own = (runs[which].metrics() for which in ("plain", "own"))
    assert [r["weights_sha256"] for r in own] == [r["weights_sha256"] for r in plain]
    assert "return_change" not in own[0]
    assert own[1]["return_change"] == own[1]["return_px"] - own[0]["return_px"]


@pytest.mark.parametrize("option", [["--kernel", "blas"], ["--callbacks", "gap"]])
def test_what_is_not_installed_is_one_line(
    tmp_path: Path, command: Callable[..., list[str]], option: list[str]
) -> None:
    done = subprocess.run(
        command("train", *SMALL, *option, "--runs-dir", str(tmp_path)),
        check=False, timeout=60, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert f"{option[1]!r} is not installed here; there are: " in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
