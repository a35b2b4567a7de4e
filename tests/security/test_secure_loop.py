"""The whole loop over mutual TLS, every service with its own role's rights: nothing that it needs is refused."""

import os
import subprocess
import sys
from pathlib import Path
from uuid import UUID

import uuid_utils
from secure_router import SecureRouter

from bpn_shared.bus.certificates import FOLDER_VARIABLE
from bpn_shared.config import RunConfig
from bpn_shared.run_folder import RunFolder

CONFIG = RunConfig.for_task(
    "reaching", seed=3, iterations=2, episodes=4, epochs=1, nodes=8, datasets=1, robots=2
)


def test_a_run_finishes_under_access_control(router: SecureRouter, tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path, UUID(str(uuid_utils.uuid7())), CONFIG)

    def start(role: str, *arguments: str) -> "subprocess.Popen[bytes]":
        place = ["--run", str(folder.run), "--connect", router.endpoint, *arguments]
        variables = {FOLDER_VARIABLE: str(router.certificates / role), "OMP_NUM_THREADS": "1"}
        return subprocess.Popen(
            [sys.executable, "-m", f"bpn_{role}", *place], env={**os.environ, **variables}
        )

    learner = start("learner", "--runs-dir", str(tmp_path))
    others = [start(role, "--slot", str(i)) for i in range(2) for role in ("robot_sim", "edge")]
    try:
        assert learner.wait(120) == 0
        assert folder.state().state == "finished"
        assert len(folder.metrics()) == CONFIG.iterations
    finally:
        for process in (learner, *others):
            process.terminate()
        for process in (learner, *others):
            process.wait(10)
