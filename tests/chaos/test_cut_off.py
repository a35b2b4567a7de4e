"""A learner that loses the router for long gives its run up, and one that was idle goes on with it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from counting_proxy import CountingProxy

from bpn_shared.bus.router_watch import GIVE_UP_AFTER_S as TRULY_S
from bpn_shared.runs.folder import RunFolder

WaitFor = Callable[..., None]
LONG_S = 150.0
GIVE_UP_AFTER_S = TRULY_S if os.environ.get("BPN_CHAOS") else 5.0


@contextmanager
def learner(endpoint: str, runs: Path, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("wb") as output:
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "bpn_learner", "--connect", endpoint),
                *("--runs-dir", str(runs), "--give-up-after", str(GIVE_UP_AFTER_S)),
            ],
            stderr=output,
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait(10)


def test_the_run_of_a_learner_that_is_cut_off_goes_on_at_another(
    tmp_path: Path,
    command: Callable[..., list[str]],
    free_tcp_port: Callable[[], int],
    wait_for: WaitFor,
) -> None:
    runs, port = tmp_path / "runs", free_tcp_port()
    endpoint = f"tcp/localhost:{port}"
    up = subprocess.Popen(
        command(
            "up", "--learners", "0", "--robots", "1", "--port", "0", "--first-run", "reaching",
            "--listen", endpoint, "--runs-dir", str(runs),
        ),
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    first_log, second_log = tmp_path / "first.log", tmp_path / "second.log"
    found: list[RunFolder] = []

    def iterations() -> int:
        found[:] = [RunFolder(path.parent) for path in runs.glob("*/config.json")]
        return len(found[0].metrics()) if found else 0

    try:
        with (
            CountingProxy(port) as line,
            learner(f"tcp/localhost:{line.port}", runs, first_log) as first,
        ):
            wait_for(lambda: iterations() >= 1, "the first iteration", LONG_S)
            (folder,) = found
            with learner(endpoint, runs, second_log):
                line.cut()
                cut_s = time.monotonic()
                wait_for(lambda: folder.state().attempt == 2, "the other learner", LONG_S)
                done = iterations()
                taken_s = time.monotonic() - cut_s
                wait_for(lambda: iterations() > done, "the run to go on", LONG_S)
                print(
                    f"CUT OFF, gives up after {GIVE_UP_AFTER_S:.0f} s: taken over after {taken_s:.1f} s, "
                    f"an iteration more after {time.monotonic() - cut_s:.1f} s"
                )
                assert first.poll() is None  # it would take work again
        said = first_log.read_text()
        assert said.count("WARNING lost the router at") == 1
        assert "nobody listens" in said
        assert "gives back the lease" in said
        assert "serves run" in second_log.read_text()
        iterations_done = [record["iteration"] for record in folder.metrics()]
        assert iterations_done == list(range(len(iterations_done)))
    finally:
        up.send_signal(signal.SIGINT)
        up.wait(30)
