"""Two learners share a run's updates, and either may die in the middle of one."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from uuid import UUID

import pytest
from rich.console import Console

from bpn.local_run import execute, new_run, private_endpoint
from bpn.summary import summarize
from bpn.supervisor import Supervisor
from bpn.verify.verification import Verification
from bpn_shared.bus.metrics import MetricsSubscriber
from bpn_shared.bus.session import Bus
from bpn_shared.messages.metrics import MetricsBatch
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

WaitFor = Callable[..., None]
CONFIG = RunConfig.for_task(
    "reaching",
    seed=7,
    iterations=3,
    episodes=6,
    epochs=30,
    batch_size=32,
    hidden_units=24,
    learners=2,
)
LONG_S = 120.0


@dataclass
class Training:
    """A run that goes on in a thread, and how far its updates are."""

    folder: RunFolder
    endpoint: str = field(default_factory=private_endpoint)
    supervisors: list[Supervisor] = field(default_factory=list)
    epochs: dict[int, float] = field(default_factory=dict)
    begun_again_s: float | None = None
    """When an update has done its first epoch for the second time."""

    def run(self) -> None:
        execute(
            self.folder,
            endpoint=self.endpoint,
            stop=threading.Event(),
            out=Console(quiet=True),
            on_started=self.supervisors.append,
        )

    def note(self, batch: MetricsBatch) -> None:
        for point in batch.points:
            if point.name == "progress.epochs":
                if point.value < self.epochs.get(point.step, 0):
                    self.begun_again_s = time.monotonic()
                self.epochs[point.step] = point.value

    def pid(self, name: str) -> int | None:
        return self.supervisors[0].service(name).pid

    def log(self, name: str) -> str:
        return (self.folder.logs / f"{name}.log").read_text()


@contextlib.contextmanager
def training(runs_dir: Path) -> Iterator[Training]:
    begun = Training(new_run(runs_dir, CONFIG))
    thread = threading.Thread(target=begun.run)
    thread.start()
    with Bus(begun.endpoint) as bus:
        subscriber = MetricsSubscriber(bus, UUID(str(begun.folder.run)), begun.note)
        yield begun
        del subscriber
    thread.join(2 * LONG_S)
    assert not thread.is_alive(), "the run did not come to its end"


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> str:
    with training(tmp_path_factory.mktemp("runs")) as done:
        pass
    summary = summarize(done.folder)
    assert summary["state"] == "finished"
    assert done.log("learner-1").count("took part in the update") == CONFIG.iterations
    assert all(record["exchange_s"] > 0 for record in done.folder.metrics())
    sha256: str = summary["weights_sha256"]
    return sha256


@pytest.mark.parametrize("victim", ["learner-1", "learner"])
def test_a_learner_may_die_in_the_middle_of_a_shared_update(
    undisturbed: str, victim: str, tmp_path: Path, wait_for: WaitFor
) -> None:
    with training(tmp_path) as run:
        wait_for(lambda: run.epochs.get(1, 0) >= 2, "the middle of an update", LONG_S)
        pid = run.pid(victim)
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        killed_s = time.monotonic()
        assert not run.folder.weights_path(2).exists(), "not the middle of the update"
        wait_for(lambda: run.begun_again_s, "the update to be done again", LONG_S)
        assert run.begun_again_s is not None
        print(f"RECOVERY kill -9 {victim}: {run.begun_again_s - killed_s:.1f} s")
    survivor, says = {
        "learner-1": ("learner", "the update begins again"),
        "learner": ("learner-1", "gives up the update"),
    }[victim]
    assert says in run.log(survivor)
    assert run.supervisors[0].service(survivor).restarts == 0
    assert run.supervisors[0].service(victim).restarts == 1
    summary = summarize(run.folder)
    assert (summary["state"], summary["episodes_lost"]) == ("finished", 0)
    assert summary["weights_sha256"] == undisturbed
    assert Verification(run.folder).run().agrees
    assert run.folder.state().attempt == (2 if victim == "learner" else 1)
