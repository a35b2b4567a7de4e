"""The whole loop over mutual TLS, every service with its own role's rights: nothing that it needs is refused."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from uuid import UUID

import uuid_utils
from counting_proxy import CountingProxy
from secure_router import SecureRouter

from bpn_shared.bus.certificates import FOLDER_VARIABLE
from bpn_shared.bus.router_config import render, secure
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task(
    "reaching",
    seed=3,
    iterations=2,
    episodes=4,
    epochs=1,
    hidden_units=8,
    replay_iterations=1,
    robots=2,
    learners=2,
)
FRAME_BYTES = 84 * 84


@contextlib.contextmanager
def running(
    router: SecureRouter, role: str, *arguments: str, module: str = ""
) -> Iterator["subprocess.Popen[bytes]"]:
    """A service in a process of its own, with its role's certificates."""
    variables = {FOLDER_VARIABLE: str(router.certificates / role), "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-m", module or f"bpn_{role}", *arguments],
        env={**os.environ, **variables},
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait(10)


def train(router: SecureRouter, folder: RunFolder, slots_endpoint: str) -> None:
    """Runs learners, robots and edges, the latter two at another router, until the run is finished."""
    place = ["--run", str(folder.run), "--connect"]
    with contextlib.ExitStack() as stack:
        for slot in range(CONFIG.robots):
            for role in ("robot_sim", "edge"):
                there = [*place, slots_endpoint, "--slot", str(slot)]
                stack.enter_context(running(router, role, *there))
        here = [*place, router.endpoint, "--runs-dir", str(folder.path.parent)]
        other = [*place, router.endpoint, "--slot", "1"]  # it needs no run folder
        stack.enter_context(running(router, "learner", *other))
        learner = stack.enter_context(running(router, "learner", *here))
        assert learner.wait(120) == 0
    assert folder.state().state == "finished"
    assert len(folder.metrics()) == CONFIG.iterations


def new_folder(runs_dir: Path) -> RunFolder:
    return RunFolder.create(runs_dir, UUID(str(uuid_utils.uuid7())), CONFIG)


def test_a_run_finishes_under_access_control(router: SecureRouter, tmp_path: Path) -> None:
    train(router, new_folder(tmp_path), router.endpoint)


def test_frames_stay_at_the_site_whose_router_joins_another(
    router: SecureRouter, tmp_path: Path, free_tcp_port: Callable[[], int]
) -> None:
    site = f"tls/localhost:{free_tcp_port()}"
    file = tmp_path / "site.json5"
    file.write_text(render(secure(site, PurePosixPath(router.certificates / "router"))))
    with CountingProxy(int(router.endpoint.rpartition(":")[2])) as line:
        upstream = f"tls/localhost:{line.port}"
        options = ["--config", str(file), "--upstream", upstream]
        with running(router, "router", *options, module="bpn_shared.bus.router"):
            train(router, new_folder(tmp_path), site)
        steps = CONFIG.iterations * CONFIG.episodes * CONFIG.steps
        print(f"{line.there_bytes} bytes to the center, {line.back_bytes} back, in {steps} steps")
        assert 0 < line.there_bytes < 0.3 * steps * FRAME_BYTES
