"""Plays a run's weights: router, robots and edges as in training, and a host in the learner's place."""

import contextlib
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from bpn.evaluation.host import TrialHost
from bpn.local_run import RunFailedError, private_endpoint
from bpn.stall_notice import LocalStalls, StallNotice
from bpn.supervisor import Supervisor, router_and_slots
from bpn_shared.bnn.weights import Weights
from bpn_shared.bus.session import Bus, BusError, prepare_process
from bpn_shared.bus.telemetry import TelemetryWatch
from bpn_shared.counters import Counters
from bpn_shared.errors import InputError
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.disturbances import of_scope, shown
from bpn_shared.spec.sections import Pacing

PlayedPolicy = Literal["greedy", "softmax", "random"]
OnProgress = Callable[[int], None]
"""Is told how many trials are over."""
Say = Callable[[str], None]
"""Prints a line."""

_START_S, _LOOK_S = 180.0, 0.05


@dataclass(frozen=True, slots=True)
class TrialPlan:
    """What is played.

    Attributes:
        count: trials.
        policy: greedy takes the best action, softmax draws as CVI's training does (Eq. 9), random ignores
            the network.
        seed: of the trials' starts and draws; trials with one seed are comparable across runs.
        changes: of the run's configuration, such as its pacing, or disturbances in place of its own (None: those,
            in lockstep without latency).
    """

    count: int
    policy: PlayedPolicy
    seed: int
    changes: dict[str, Any]

    def config(self, trained: RunConfig) -> RunConfig:
        """The configuration that robots and edges get.

        Raises:
            ConfigError: a change is outside its range.
        """
        disturb = self.changes.get("disturb")
        if disturb is None:
            disturb = _kept(trained, self.changes.get("pacing", trained.pacing))
        try:
            task = trained.task_spec.disturbed(disturb)
        except InputError as error:
            raise ConfigError(f"disturb = {disturb!r}: {error}") from error
        values = trained.model_dump() | self.changes
        return RunConfig.parse(values | {"seed": self.seed, "task_spec": task, "disturb": disturb})


def _kept(trained: RunConfig, pacing: Pacing) -> str:
    """Of a run's disturbances, those that there are with another pacing: latency needs real time."""
    levels = trained.task_spec.disturbances
    timed = of_scope(levels, "time") if pacing == "lockstep" else {}
    return shown({name: level for name, level in levels.items() if name not in timed})


def play(
    folder: RunFolder,
    weights: Weights,
    trials: TrialPlan,
    stop: threading.Event,
    *,
    on_progress: OnProgress = lambda _: None,
    say: Say = lambda _: None,
    gym_modules: Collection[str] = (),
) -> list[Episode]:
    """Plays all trials.

    Args:
        weights: weights of that run.
        say: gets a line where no trial makes progress, with the reason.
        gym_modules: what robots may import for a `gym:` task.

    Returns:
        The episodes in order of their trials; fewer if `stop` was set.

    Raises:
        ConfigError: the trials do not suit the run.
        RunFailedError: a service failed for good, or no trial ends; their logs are kept.
    """
    config = trials.config(folder.config())
    endpoint, logs = private_endpoint(), Path(tempfile.mkdtemp(prefix="bpn-eval-"))
    robots = min(config.robots, trials.count)
    supervisor = Supervisor(router_and_slots(folder.run, robots, endpoint, gym_modules), logs)
    episodes: list[Episode] = []
    prepare_process()
    try:
        supervisor.start()
        with Bus(endpoint, stop=stop) as bus:
            host = TrialHost(
                bus, folder.run, config, weights, count=trials.count, policy=trials.policy
            )
            stalls = LocalStalls(config.steps, logs, StallNotice(say))
            with contextlib.closing(TelemetryWatch(bus, stalls.hear, Counters())):

                def look(played: int) -> str:
                    return stalls.look(played, connected=bus.connected)

                _wait(host, supervisor, stop, on_progress, look)
            episodes = host.episodes()
    except (BusError, TrialsFailedError) as error:
        if not stop.is_set():
            raise RunFailedError(f"{error}; what the services said is in {logs}") from error
    finally:
        supervisor.stop()
    shutil.rmtree(logs)
    return episodes


class TrialsFailedError(RuntimeError):
    """The trials cannot be played to their end."""


def _wait(
    host: TrialHost,
    supervisor: Supervisor,
    stop: threading.Event,
    on_progress: OnProgress,
    look: Callable[[int], str],
) -> None:
    """Until all trials are over or `stop` is set; `look` says why there is no progress, if there is none."""
    patience_s = _START_S + 2 * host.trial_s
    told, deadline_s = -1, 0.0
    while not (host.over.wait(_LOOK_S) or stop.is_set()):
        supervisor.check()
        if supervisor.failure:
            raise TrialsFailedError(supervisor.failure)
        if host.played > told:
            told, deadline_s = host.played, time.monotonic() + patience_s
            on_progress(told)
        why = look(host.played)
        if time.monotonic() > deadline_s:
            why = f": {why}" if why else ""
            raise TrialsFailedError(f"no trial ended within {patience_s:.0f} s{why}")
    if host.failure:
        raise TrialsFailedError(host.failure)
    on_progress(host.played)
