"""A run to disturb, and how to see that work goes on and that nothing was lost."""

import contextlib
import itertools
import json
import time
from collections.abc import Iterator

from compose_project import Project, docker

LONG = {
    "iterations": 5,
    "episodes": 40,
    "epochs": 1,
    "hidden_units": 24,
    "replay_iterations": 2,
    "seed": 11,
}
RUN_TIMEOUT_S = 420.0
RECOVERY_TIMEOUT_S = 60.0
GOES_ON = 20
"""So many more episodes show that work goes on."""
FACTS = """
import json, sys
from pathlib import Path
from bpn_shared.runs.folder import RunFolder
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
        self._times = f"find /runs/{run}/episodes -name '*.bpne' -printf '%T@\\n' 2>/dev/null"

    def stored_unix_s(self) -> list[float]:
        """When each episode was stored, in order."""
        return sorted(map(float, docker("exec", self._container, "sh", "-c", self._times).split()))

    def wait_beyond(self, count: int, timeout_s: float = RECOVERY_TIMEOUT_S) -> list[float]:
        """Waits until more than `count` episodes are stored; returns when each of them was."""
        deadline_s = time.monotonic() + timeout_s
        while len(stored := self.stored_unix_s()) <= count:
            assert time.monotonic() < deadline_s, f"no episode for {timeout_s:.0f} s"
            time.sleep(0.1)
        return stored


def report_pause(fault: str, progress: Progress, since_unix_s: float) -> None:
    """Waits until work goes on after a blow; prints the longest time without a new episode, before and since."""
    goal = min(len(progress.stored_unix_s()) + GOES_ON, LONG["iterations"] * LONG["episodes"] - 1)
    stored = progress.wait_beyond(goal)
    before = [stored_s for stored_s in stored if stored_s <= since_unix_s]
    since = [*before[-1:], *stored[len(before) :]]
    print(f"PAUSE {fault}: {longest_s(since):.1f} s, before it {longest_s(before):.1f} s")


def longest_s(times_unix_s: list[float]) -> float:
    """The longest interval."""
    return max((b - a for a, b in itertools.pairwise(times_unix_s)), default=0.0)


@contextlib.contextmanager
def reported_return(fault: str, progress: Progress) -> Iterator[None]:
    """The body ends a fault that nothing is stored under; prints how long after that an episode is."""
    before = len(progress.stored_unix_s())
    yield
    ended_unix_s = time.time()
    first = progress.wait_beyond(before)[before]
    print(f"RETURN {fault}: {max(0.0, first - ended_unix_s):.1f} s after its end")


def kill_main(container: str) -> None:
    """kill -9 of the container's main process: what `docker kill` does counts as a manual stop."""
    docker("exec", container, "bash", "-c", "kill -9 $(cat /proc/1/task/1/children)")
