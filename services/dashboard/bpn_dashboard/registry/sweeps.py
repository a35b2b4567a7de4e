"""From a grid to runs: every combination of the grid's values, with every seed."""

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from bpn_shared.runs.creation import Workplace, configure
from bpn_shared.spec.config import OPTIONS, ConfigError, RunConfig
from bpn_shared.spec.renamed import called_now

MAX_RUNS = 1000


@dataclass(frozen=True)
class SweepRun:
    """One run of a sweep; its name tells it from the others."""

    name: str
    config: RunConfig


def expand(
    config: Mapping[str, Any],
    grid: Mapping[str, Sequence[Any]],
    seeds: Sequence[int],
    place: Workplace,
) -> list[SweepRun]:
    """The runs of a sweep, in the grid's order with the last key and then the seed varying fastest.

    Args:
        config: the task, and what is changed from its preset in every run; the grid has precedence.
        grid: for configuration keys (the task too), the values to try.
        seeds: one run for each; none: the configuration's own.
        place: where the runs will be done; of each Gymnasium environment it is asked once.

    Raises:
        ConfigError: a key is unknown, or a value is wrong or stands twice; the message names both.
    """
    axes = dict(grid)
    if seeds:
        axes = {key: values for key, values in axes.items() if key != "seed"} | {"seed": seeds}
    _check(grid, seeds, axes)
    place = _AskedOnce(place)
    runs = []
    for values in itertools.product(*axes.values()):
        point = dict(zip(axes, values, strict=True))
        made = configure({**config, **point}, place)
        name = " ".join(f"{key}={_text(value)}" for key, value in point.items())
        runs.append(SweepRun(name or f"task={made.task}", made))
    return runs


class _AskedOnce:
    """A workplace that remembers what it was told of environments."""

    def __init__(self, place: Workplace) -> None:
        self.probe = cache(place.probe)
        self.check = place.check


def _check(
    grid: Mapping[str, Sequence[Any]], seeds: Sequence[int], axes: Mapping[str, Sequence[Any]]
) -> None:
    keys = OPTIONS
    if seeds and "seed" in grid:
        raise ConfigError("grid: seed: the seeds are given already; leave out one of the two")
    count = 1
    for key, values in axes.items():
        if key not in keys:
            why = called_now(key) or f"unknown; one of: {', '.join(keys)}"
            raise ConfigError(f"grid: {key}: {why}")
        if not values:
            raise ConfigError(f"grid: {key}: no values")
        seen = [_text(value) for value in values]
        for text in seen:
            if seen.count(text) > 1:
                raise ConfigError(f"grid: {key} = {text}: stands there twice")
        count *= len(values)
    if count > MAX_RUNS:
        raise ConfigError(f"the grid has {count} runs, the limit is {MAX_RUNS}")


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
