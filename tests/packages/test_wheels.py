"""What `make dist` built, as its users get it: clean environments, no compiler, no Node, no repository."""

import os
import subprocess
import tarfile
import zipfile
from collections.abc import Callable, Mapping
from email.parser import Parser
from pathlib import Path
from urllib.request import urlopen

import pytest
from pool import running_pool

from bpn_shared.version import VERSION

DIST = Path(__file__).parents[2] / "dist"
PYTHONS = os.environ["BPN_PYTHONS"].split()
WHEELS = sorted(DIST.glob("bpn*.whl"))
SOURCES = sorted(DIST.glob("bpn*.tar.gz"))


def _name(path: Path) -> str:
    return path.name.partition("-")[0]


def test_every_distribution_has_sources_and_a_wheel() -> None:
    assert {_name(wheel) for wheel in WHEELS} == {_name(archive) for archive in SOURCES}
    assert len(SOURCES) == 9


@pytest.mark.parametrize("wheel", WHEELS, ids=lambda wheel: wheel.name)
def test_a_wheel_has_licence_types_and_equal_versions(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
        (metadata,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        told = Parser().parsestr(packed.read(metadata).decode())
        (licence,) = (name for name in names if name.endswith("licenses/LICENSE"))
        assert b"Apache License" in packed.read(licence)
    assert (told["Version"], told["License-Expression"]) == (VERSION, "Apache-2.0")
    ours = [need for need in told.get_all("Requires-Dist", []) if need.startswith("bpn")]
    assert all(f"=={VERSION}" in need for need in ours), ours
    assert any(name.endswith("/py.typed") for name in names)
    compiled_later = "/rtl/"  # Verilator's, at the edge
    sources = [
        name for name in names if name.endswith((".cpp", ".h")) and compiled_later not in name
    ]
    assert not sources + [name for name in names if "__pycache__" in name]


@pytest.mark.parametrize("archive", SOURCES, ids=lambda archive: archive.name)
def test_sources_have_their_licence(archive: Path) -> None:
    with tarfile.open(archive) as packed:
        assert any(name.endswith("/LICENSE") for name in packed.getnames())


@pytest.fixture(scope="module", params=PYTHONS, ids=lambda python: Path(python).name)
def installed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of programs of an environment that has the wheels, and nothing of the repository."""
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([request.param, "-m", "venv", str(folder)], check=True)
    install = [
        str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--only-binary", ":all:",
        "--find-links", str(DIST), "--constraint", str(DIST / "constraints.txt"), "bpn",
    ]  # fmt: skip
    subprocess.run(install, check=True, env=_bare(folder), cwd=folder, timeout=900)
    return folder / "bin"


def _bare(environment: Path) -> Mapping[str, str]:
    """No program but the environment's own: neither compiler nor Node, git, make or cmake."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    return kept | {"PATH": str(environment / "bin")}


@pytest.mark.timeout(1200)
def test_up_learns_in_an_empty_folder(
    installed: Path, tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    bare = _bare(installed.parent)
    said = subprocess.run(
        [installed / "bpn", "--version"],
        env=bare,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout.startswith(f"bpn {VERSION},")
    runs = tmp_path / "runs"
    with running_pool(
        runs,
        environment=bare,
        program=(str(installed / "python"), "-P", "-m", "bpn"),
        folder=tmp_path,
    ) as pool:
        page = urlopen(pool.dashboard.url, timeout=30).read().decode()
        assert '<script type="module"' in page
        quick = {"task": "reaching", "iterations": 1, "episodes": 2, "steps": 10, "epochs": 1}
        run = pool.dashboard.create_run(quick)["id"]
        wait_for(lambda: pool.state(run) == "finished", "the run to finish", 300)
        assert len(pool.sha256(run)) == 64
