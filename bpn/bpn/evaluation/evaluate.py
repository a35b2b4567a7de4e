"""Evaluation of a run: its policy plays trials by real processes, and what came of them."""

import threading
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from bpn.evaluation.outcome import distinct_trials, outcome, summarize
from bpn.evaluation.trials import OnProgress, PlayedPolicy, Say, TrialPlan, play
from bpn.run import Run, Version
from bpn.this_machine import ThisMachine
from bpn_shared.errors import InputError
from bpn_shared.messages.episode import Episode
from bpn_shared.runtime.gym_modules import allowed_modules
from bpn_shared.spec.sections import Pacing


@dataclass(frozen=True)
class Evaluation:
    """What trials came to.

    Attributes:
        result: run, weights version, what was played, and the statistics of `outcome.summarize`: what
            `bpn eval --json` prints.
        episodes: the trials, in order.
    """

    result: dict[str, Any]
    episodes: list[Episode]


def evaluate(
    run: Run,
    *,
    trials: int = 10,
    policy: PlayedPolicy = "greedy",
    version: Version = None,
    seed: int | None = None,
    pacing: Pacing = "lockstep",
    action_delay_ms: float = 0.0,
    disturb: str | None = None,
    kernel: str | None = None,
    robots: int = 1,
    gym_modules: Collection[str] = (),
    stop: threading.Event | None = None,
    on_progress: OnProgress = lambda _: None,
    say: Say = lambda _: None,
) -> Evaluation:
    """Plays a run's policy, as `bpn eval` does: robots and edges are processes, as in training.

    Args:
        trials: how many episodes.
        policy: greedy takes the best action, softmax draws from the softmax policy, random ignores the network.
        version: of the weights; "best" is the one of the evaluations during training, None the newest.
        seed: of starts and draws; None: the run's.
        action_delay_ms: time added between a frame and its action's effect; needs realtime pacing.
        disturb: disturbances of camera and servos, such as "noise=25,offset=-30..30"; "": none; None: the run's,
            in lockstep without its latency.
        kernel: an installed one, such as "golden"; None: the run's.
        robots: how many trials are played side by side.
        gym_modules: what may be imported for a `gym:` task.
        stop: ends the evaluation when it is set.
        on_progress: is told how many trials are over.
        say: gets a line where no trial makes progress, with the reason.

    Raises:
        InputError: an argument is wrong, or this machine cannot play the run.
        RunFailedError: the trials cannot be played to their end; the message says why.
        KeyboardInterrupt: Ctrl-C, or `stop` was set.
    """
    if trials < 1:
        raise InputError(f"trials = {trials} must be at least 1")
    changes = {
        "pacing": pacing,
        "action_delay_ms": action_delay_ms,
        "disturb": disturb,
        "robots": robots,
        "kernel": kernel or run.config.kernel,
    }
    played = TrialPlan(trials, policy, run.config.seed if seed is None else seed, changes)
    config, weights = played.config(run.config), run.weights(version)
    modules = allowed_modules(",".join(gym_modules))
    ThisMachine(modules).check_playing(config)
    stop = stop or threading.Event()
    episodes = play(
        run.folder, weights, played, stop, on_progress=on_progress, say=say, gym_modules=modules
    )
    if stop.is_set():
        raise KeyboardInterrupt
    outcomes = [outcome(config, episode) for episode in episodes]
    result = {
        "run_id": run.id,
        "task": config.task,
        "algorithm": config.algorithm,
        "weights_version": weights.version,
        "policy": policy,
        "seed": played.seed,
        "pacing": config.pacing,
        "action_delay_ms": config.action_delay_ms,
        "disturb": config.disturb,
        **summarize(config, outcomes, distinct=distinct_trials(episodes)),
    }
    return Evaluation(result, episodes)
