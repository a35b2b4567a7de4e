"""Makes a target: its runs, its measurements, its files."""

import json
import shlex
import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from bpn.reproduce import report
from bpn.reproduce.definition import Context, Scope, StoppedError, Target
from bpn.reproduce.experiment import Campaign
from bpn.reproduce.manifest import locked
from bpn.reproduce.targets import TARGETS
from bpn_shared.spec.config import ConfigError

_SEEDS, _QUICK_SEEDS = 5, 2


def make(
    name: str,
    *,
    seeds: int | None,
    algorithms: Sequence[str] | None,
    hidden_units: Sequence[int] | None,
    iterations: int | None,
    quick: bool,
    first_seed: int = 0,
    jobs: int,
    out_dir: Path,
    runs_dir: Path,
    command: str,
    stop: threading.Event,
    out: Console,
) -> int:
    """Makes a target by name.

    Returns:
        The exit status: 0, or 130 if `stop` was set before everything was there.

    Raises:
        ConfigError: the target does not compare one of the algorithms, or another campaign is at work.
        RunFailedError: a run failed for good.
    """
    target = TARGETS[name]
    scope = Scope(
        seeds=seeds or (_QUICK_SEEDS if quick else _SEEDS),
        algorithms=_chosen(target, algorithms),
        iterations=iterations,
        quick=quick,
        hidden_units=hidden_units,
        first_seed=first_seed,
    )
    configs = target.plan(scope)
    say = partial(out.print, highlight=False, soft_wrap=True)
    with locked(runs_dir):
        campaign = Campaign(runs_dir, jobs, stop, say)
        say(f"{target.title}: {len(configs)} runs, {jobs} side by side, in {runs_dir}")
        try:
            runs = campaign.train(configs)
            result = target.measure(Context(scope, runs, campaign.play, say, stop))
        except StoppedError as stopped:
            say(
                f"stopped: {stopped}; go on with: {command} --runs-dir {shlex.quote(str(runs_dir))}"
            )
            return 130
        made = report.document(target, command, runs, result, quick=quick)
        for path in report.write(target, made, out_dir):
            say(f"wrote {path}")
    return 0


def redraw(name: str, out_dir: Path, out: Console) -> int:
    """Draws a target's figure and table anew from the results in its JSON file; measures nothing.

    Raises:
        ConfigError: the file is not there or holds no results of this target.
    """
    target, path = TARGETS[name], out_dir / f"{name}.json"
    try:
        made = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"--redraw needs {path}, made by `bpn reproduce {name}`: {error}"
        ) from None
    if not isinstance(made, dict) or made.get("target") != name:
        raise ConfigError(f"{path} does not hold results of {name}")
    try:
        drawn = report.draw(target, made, out_dir)
    except KeyError as missing:
        raise ConfigError(f"{path} has no {missing}: another version made it") from None
    for file in drawn:
        out.print(f"wrote {file}", highlight=False, soft_wrap=True)
    return 0


def _chosen(target: Target, algorithms: Sequence[str] | None) -> tuple[str, ...]:
    if algorithms is None or not target.algorithms:
        return target.algorithms
    unknown = sorted(set(algorithms) - set(target.algorithms))
    if unknown:
        raise ConfigError(
            f"--algorithms {','.join(algorithms)}: {target.name} compares {', '.join(target.algorithms)}, "
            f"not {', '.join(unknown)}"
        )
    return tuple(algorithm for algorithm in target.algorithms if algorithm in algorithms)
