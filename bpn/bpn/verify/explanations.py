"""What would explain an update that is not the one that was asked for: likely slips, tried one by one."""

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from bpn.verify import draws
from bpn.verify.targets import Targets
from bpn.verify.trainee import Trainee, released
from bpn.verify.training import Gradients, autograd, compiled, learning_rate_factors, train
from bpn.verify.update import Update
from bpn.verify.weights import distance, same_bits
from bpn_shared.spec.config import RunConfig

_NEAR = 1e-5
"""Relative distance of float weights that are the same but for rounding."""
_OF_TARGETS = (
    "alpha", "beta", "gamma", "bootstrap_terminals", "relative_targets", "reward_scale",
)  # fmt: skip
_OF_TRAINING = ("epochs", "batch_size", "learning_rate")

Backend = Callable[[Trainee, Targets], Gradients]


def of_targets(update: Update, fits: Callable[[Targets], bool]) -> str:
    """Why the largest target is another than it should be; "" if nothing that is tried explains it."""
    for name, other in _defaults_instead(update.config, _OF_TARGETS):
        if fits(update.targets(other)):
            return f"it is that of {name}"
    return ""


def of_weights(update: Update, before: Trainee) -> str:
    """Why an update left other weights than it should; "" if nothing that is tried explains it.

    Args:
        before: the network and optimizer that it began with.
    """
    config, seed = update.config, update.config.seed
    tried = partial(_fits, update)
    flat, level = {"lr_update_final_factor": 1.0}, {"lr_run_final_factor": 1.0}
    other_backend = autograd if config.backend == "native" else compiled
    slips: dict[str, Callable[[], bool]] = {
        "without annealing within the update": lambda: tried(_Slip(before, _with(config, **flat))),
        "without annealing over the run": lambda: tried(_Slip(before, _with(config, **level))),
        "without annealing": lambda: tried(_Slip(before, _with(config, **flat, **level))),
        "without clipping of latent weights": lambda: tried(_Slip(before, config, clips=False)),
        "with the shuffles of iteration 0": lambda: tried(
            _Slip(before, config, shuffles=draws.shuffles(seed, 0))
        ),
        "with the shuffles of seed 0": lambda: tried(
            _Slip(before, config, shuffles=draws.shuffles(0, update.iteration))
        ),
        "with Adam begun anew": lambda: tried(_Slip(_begun_anew(before), config)),
        "by the other backend": lambda: tried(_Slip(before, config, backend=other_backend)),
    }
    for name, other in _defaults_instead(config, (*_OF_TARGETS, *_OF_TRAINING)):
        slips[f"with {name}"] = partial(tried, _Slip(before, other))
    return next((f"it is an update {name}" for name, slip in slips.items() if slip()), "")


def backend_of(config: RunConfig) -> Backend:
    """What computes the run's gradients."""
    return compiled if config.backend == "native" and config.device == "cpu" else autograd


@dataclass(frozen=True, eq=False)
class _Slip:
    """Another way to do an update."""

    start: Trainee
    config: RunConfig
    shuffles: np.random.Generator | None = None
    backend: Backend | None = None
    clips: bool = True


def _fits(update: Update, slip: _Slip) -> bool:
    """Whether the update done in this way leaves the weights that the run has."""
    trainee, data = copy.deepcopy(slip.start), update.targets(slip.config)
    trainee.clips = slip.clips
    train(
        trainee,
        data,
        (slip.backend or backend_of(slip.config))(trainee, data),
        factors=learning_rate_factors(slip.config, update.iteration, len(data.y)),
        batch_size=slip.config.batch_size,
        shuffles=slip.shuffles or draws.shuffles(slip.config.seed, update.iteration),
    )
    own = released(trainee, data.seen)
    near = not own.binary and distance(update.following, own) < _NEAR
    return near or same_bits(own, update.following)


def _defaults_instead(config: RunConfig, names: Sequence[str]) -> Iterator[tuple[str, RunConfig]]:
    """The configuration with one option at its default, for each that is not."""
    for name in names:
        default = RunConfig.model_fields[name].default
        if getattr(config, name) != default:
            yield f"{name} = {default}", _with(config, **{name: default})


def _with(config: RunConfig, **changes: Any) -> RunConfig:
    return config.model_copy(update=changes)


def _begun_anew(trainee: Trainee) -> Trainee:
    fresh = copy.deepcopy(trainee)
    fresh.adam.state.clear()
    return fresh
