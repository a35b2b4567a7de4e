"""Two sites with routers, a run with slots at both, and an edge that dies: frames never cross a site's router."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from namespaces import NetworkMachine, connect, machine, running
from other_machines import Typed, typed

WaitFor = Callable[..., None]
ITERATIONS, EPISODES, STEPS = 4, 12, 20
FRAMES_BYTES = ITERATIONS * EPISODES * STEPS * 84 * 84
IDLE_S = 15.0
UP = "bpn up --robots 0 --listen tls/0.0.0.0:7447"
JOIN = r"bpn join bpn1-\S+"
RUN = (
    f"bpn train reaching --robots 4 --iterations {ITERATIONS} --episodes {EPISODES} --epochs 1 "
    "--hidden-units 32"
)


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[tuple[NetworkMachine, NetworkMachine, NetworkMachine]]:
    with (
        machine(tmp_path / "center") as center,
        machine(tmp_path / "lab-a") as a,
        machine(tmp_path / "lab-b") as b,
    ):
        connect(center, "10.77.1.1/24", a, "10.77.1.2/24")
        connect(center, "10.77.2.1/24", b, "10.77.2.2/24")
        yield center, a, b


def an_edge_at_work(at: NetworkMachine, log: Path) -> int | None:
    """The process of one of a machine's edges that has a slot."""
    if "serves run" not in (log.read_text() if log.exists() else ""):
        return None
    for pid in map(int, at.run(["ip", "netns", "pids", at.namespace], 10).stdout.split()):
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        if b"bpn_edge" in words and any(word.endswith(b"/1") for word in words):
            return pid
    return None


def test_who_has_joined_works_on_when_bpn_up_is_started_again(
    machines: tuple[NetworkMachine, NetworkMachine, NetworkMachine], wait_for: WaitFor
) -> None:
    center, a, _ = machines
    short = typed("bpn train reaching --iterations 1 --episodes 2 --epochs 1 --hidden-units 32")
    up = Typed(center, UP)
    with running(up.process):
        wait_for(lambda: up.printed(JOIN), "the router of the center", 120)
        joined = Typed(a, str(up.printed(JOIN)))
        with running(joined.process):
            assert center.run(short, 300).returncode == 0
            up.process.send_signal(signal.SIGINT)
            assert up.process.wait(30) == 130
            again = Typed(center, UP)
            with running(again.process):
                wait_for(lambda: again.printed(JOIN), "the router of the center again", 120)
                done = center.run(short, 300)
                assert done.returncode == 0, done.stderr + joined.text()


def idle_bytes_per_s(*machines: NetworkMachine) -> float:
    """What leaves the machines while their workers have no work: telemetry, questions for work."""
    before = sum(at.sent_bytes() for at in machines)
    threading.Event().wait(IDLE_S)
    return (sum(at.sent_bytes() for at in machines) - before) / IDLE_S


def test_frames_never_cross_a_sites_router(
    machines: tuple[NetworkMachine, NetworkMachine, NetworkMachine], wait_for: WaitFor
) -> None:
    center, a, b = machines
    up = Typed(center, UP)
    with running(up.process):
        wait_for(lambda: up.printed("bpn join"), "the router of the center", 120)
        joined = []
        for site, at, how in (("lab-a", a, "--robots 2 --edges 4"), ("lab-b", b, "--robots 2")):
            invited = center.run(typed(f"bpn invite --site {site} --name {site}-1"), 60)
            assert invited.returncode == 0, invited.stderr
            joined.append(Typed(at, f"{invited.stdout.strip()} {how}"))
        with running(joined[0].process), running(joined[1].process):
            for one in joined:
                wait_for(lambda one=one: one.printed("at site lab-"), "a machine to join", 60)
            sent_bytes, begin_s = a.sent_bytes() + b.sent_bytes(), time.monotonic()
            train = Typed(center, RUN)
            log = b.home / ".local/state/bpn/machine/logs/edge-1.log"
            wait_for(lambda: an_edge_at_work(b, log), "an edge of lab-b at work", 120)
            edge = an_edge_at_work(b, log)
            assert edge is not None
            os.kill(edge, signal.SIGSTOP)  # killed, it would be there again at once
            try:
                train.process.wait(400)
            finally:
                os.kill(edge, signal.SIGCONT)
            (folder,) = (center.home / "runs").glob("*-*-*-*-*")
            assert '"finished"' in (folder / "state.json").read_text()
            sent_bytes = a.sent_bytes() + b.sent_bytes() - sent_bytes
            took_s = time.monotonic() - begin_s
            idle_bytes = idle_bytes_per_s(a, b) * took_s
            print(
                f"{sent_bytes} bytes left the sites in {took_s:.0f} s, {idle_bytes:.0f} of them as when idle; "
                f"{FRAMES_BYTES} bytes of frames were played"
            )
            assert sent_bytes - idle_bytes < FRAMES_BYTES / 8  # one slot's are a quarter
