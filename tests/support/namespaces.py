"""Machines with addresses of their own on this one: network namespaces, and the cables between them."""

import contextlib
import itertools
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

_numbers = itertools.count()


@dataclass(frozen=True)
class NetworkMachine:
    """A network of its own, and what runs in it."""

    namespace: str
    home: Path

    def popen(self, words: Sequence[str], **options: Any) -> "subprocess.Popen[str]":
        """Starts a command there, at home."""
        self.home.mkdir(exist_ok=True)
        return subprocess.Popen(
            ["ip", "netns", "exec", self.namespace, *words],
            cwd=self.home, text=True, env=self.environment(), **options,
        )  # fmt: skip

    def run(self, words: Sequence[str], timeout_s: float) -> "subprocess.CompletedProcess[str]":
        """Runs a command there to its end."""
        self.home.mkdir(exist_ok=True)
        return subprocess.run(
            ["ip", "netns", "exec", self.namespace, *words],
            cwd=self.home, text=True, env=self.environment(), timeout=timeout_s, check=False, capture_output=True,
        )  # fmt: skip

    def environment(self) -> Mapping[str, str]:
        """As on a machine of somebody's own."""
        return {**os.environ, "HOME": str(self.home), "XDG_STATE_HOME": ""}

    def sent_bytes(self) -> int:
        """What has left it, on all its cables, as the kernel counts."""
        counters = self.run(["cat", "/proc/net/dev"], 10).stdout.splitlines()[2:]
        fields = (line.partition(":") for line in counters)
        return sum(int(values.split()[8]) for name, _, values in fields if name.strip() != "lo")


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=10)


@contextlib.contextmanager
def machine(home: Path) -> Iterator[NetworkMachine]:
    """A machine without any cable.

    Where none can be made, the test is skipped, and says why.
    """
    name = f"bpn-{os.getpid()}-{next(_numbers)}"
    if shutil.which("ip") is None or os.geteuid() != 0:
        pytest.skip(
            "NO NETWORK NAMESPACES: they need root and iproute2; nobody has seen other machines join"
        )
    try:
        ip("netns", "add", name)
    except subprocess.CalledProcessError as error:
        pytest.skip(
            f"NO NETWORK NAMESPACES: {error.stderr.strip()}; nobody has seen other machines join"
        )
    try:
        ip("-n", name, "link", "set", "lo", "up")
        yield NetworkMachine(name, home)
    finally:
        ip("netns", "del", name)


def connect(one: NetworkMachine, its_address: str, other: NetworkMachine, address: str) -> None:
    """Lays a cable between two machines; addresses with the length of their network, as "10.0.0.1/24"."""
    number = next(_numbers)
    ends = f"v{os.getpid()}a{number}", f"v{os.getpid()}b{number}"
    ip("link", "add", ends[0], "netns", one.namespace, "type", "veth", "peer", "name", ends[1],
       "netns", other.namespace)  # fmt: skip
    for there, end, own in ((one, ends[0], its_address), (other, ends[1], address)):
        ip("-n", there.namespace, "address", "add", own, "dev", end)
        ip("-n", there.namespace, "link", "set", end, "up")


@contextlib.contextmanager
def running(
    process: "subprocess.Popen[str]", end_s: float = 30.0
) -> Iterator["subprocess.Popen[str]"]:
    """Ends it with SIGINT, as Ctrl-C does."""
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(2)
        try:
            process.wait(end_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
