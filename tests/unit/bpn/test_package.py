"""The folder `bpn` in the repository's root, which holds the package, does not stand in its way."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[3]


def python(cwd: Path, program: str, *options: str) -> str:
    done = subprocess.run(
        [sys.executable, *options, "-c", program],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()[-1]


def test_it_is_found_from_the_root_of_the_repository() -> None:
    assert python(ROOT, "import bpn; print(bpn.__file__)") == str(ROOT / "bpn/bpn/__init__.py")


def test_an_editable_install_is_found_from_the_root_of_the_repository(tmp_path: Path) -> None:
    root, site = tmp_path / "repository", tmp_path / "site"
    shutil.copytree(
        ROOT / "bpn", root / "bpn", ignore=shutil.ignore_patterns("*.egg-info", "build")
    )
    site.mkdir()
    build = (
        f"from setuptools.build_meta import build_editable; print(build_editable({str(site)!r}))"
    )
    wheel = python(root / "bpn", build)
    zipfile.ZipFile(site / wheel).extractall(site)
    find = (
        f"import site, sys, importlib.util; sys.path.insert(0, ''); site.addsitedir({str(site)!r}); "
        "print(importlib.util.find_spec('bpn').origin)"
    )
    assert python(root, find, "-I", "-S") == str(root / "bpn/bpn/__init__.py")
