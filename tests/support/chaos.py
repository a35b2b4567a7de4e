"""A run to disturb, and how to see that work goes on and that nothing was lost."""

import json
import time

from compose_project import Project, docker

LONG = {"iterations": 5, "episodes": 40, "epochs": 1, "nodes": 24, "datasets": 2, "seed": 11}
RUN_TIMEOUT_S = 420.0
RECOVERY_TIMEOUT_S = 60.0
FACTS = """
import json, sys
from pathlib import Path
from bpn_shared.run_folder import RunFolder
folder = RunFolder.open(Path("/runs"), sys.argv[1])
records, stored = folder.metrics(), len(list(folder.path.glob("episodes/*.bpne")))
print(json.dumps({
    "iterations": [record["iteration"] for record in records],
    "lost": folder.config().episodes * len(records) - stored,
    "duplicated": sum(record["episodes"] for record in records) - stored,
    "weights": folder.newest_weights().content_sha256(),
}))
"""


def facts(project: Project, run: str) -> dict[str, object]:
    """What the run folder says: iterations, episodes lost and duplicated, digest of the weights."""
    said = project.compose("exec", "-T", "dashboard", "python", "-c", FACTS, run)
    found: dict[str, object] = json.loads(said)
    return found


class Progress:
    """Episodes of a run that are stored, looked at through a container that the fault does not hit."""

    def __init__(self, project: Project, run: str, victim: str) -> None:
        witness = "dashboard" if victim != "dashboard" else "learner"
        (self._container,) = project.containers(witness)
        self._count = f"ls /runs/{run}/episodes 2>/dev/null | wc -l"

    def episodes(self) -> int:
        return int(docker("exec", self._container, "sh", "-c", self._count))

    def wait_beyond(self, count: int, timeout_s: float = RECOVERY_TIMEOUT_S) -> None:
        """Waits until more than `count` episodes are stored."""
        deadline_s = time.monotonic() + timeout_s
        while self.episodes() <= count:
            assert time.monotonic() < deadline_s, f"no episode for {timeout_s:.0f} s"
            time.sleep(0.1)


def report(fault: str, progress: Progress, before: int, since_s: float) -> None:
    """Waits until more than `before` episodes are stored, and prints how long that took."""
    progress.wait_beyond(before)
    print(f"RECOVERY {fault}: {time.monotonic() - since_s:.1f} s")


def kill_main(container: str) -> None:
    """kill -9 of the container's main process: what `docker kill` does counts as a manual stop."""
    docker("exec", container, "bash", "-c", "kill -9 $(cat /proc/1/task/1/children)")
