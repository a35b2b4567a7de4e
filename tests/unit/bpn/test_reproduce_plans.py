"""What each target would run: declared, hence checked without running anything."""

from collections import Counter

import pytest

from bpn.commands.reproduce import NAMES
from bpn.reproduce.definition import Scope
from bpn.reproduce.manifest import config_hash
from bpn.reproduce.targets import TARGETS
from bpn_shared.spec.config import ConfigError, RunConfig


def plan(name: str, seeds: int = 5, *, quick: bool = False) -> list[RunConfig]:
    target = TARGETS[name]
    return target.plan(Scope(seeds, target.algorithms, quick))


def test_the_command_offers_every_target() -> None:
    assert tuple(TARGETS) == NAMES


@pytest.mark.parametrize(
    ("name", "runs"),
    # two binary algorithms at three N and two float ones; a grid of 4 x 4; two algorithms; one
    [("reaching", 8), ("tracking", 8), ("heatmap", 16), ("pan-tilt", 2), ("inference", 0), ("latency", 1),
     ("averaging", 0), ("cartpole", 1), ("robustness", 6), ("robustness-pan-tilt", 6)],
)  # fmt: skip
@pytest.mark.parametrize("seeds", [1, 5])
def test_every_configuration_runs_once_on_every_seed(name: str, runs: int, seeds: int) -> None:
    configs = plan(name, seeds)
    assert len(configs) == runs * seeds
    assert len({config_hash(config) for config in configs}) == len(configs)
    assert (
        Counter(config.seed for config in configs) == dict.fromkeys(range(seeds), runs) or not runs
    )


@pytest.mark.parametrize("name", TARGETS)
def test_the_first_seed_is_complete_before_the_second_begins(name: str) -> None:
    seeds = [config.seed for config in plan(name)]
    assert seeds == sorted(seeds)


@pytest.mark.parametrize("name", ["reaching", "tracking"])
def test_learning_curves_compare_what_the_paper_compares(name: str) -> None:
    compared = Counter(config.algorithm for config in plan(name, 1))
    assert compared == {"bpn": 3, "bqn": 3, "cvi": 1, "dqn": 1}
    sizes = {config.hidden_units for config in plan(name, 1) if config.algorithm == "bpn"}
    assert (
        RunConfig.for_task(name).hidden_units in sizes
    )  # the runs that everything else talks about
    changed = {"algorithm", "algorithm_spec", "kernel", "hidden_units", "seed"}
    preset = RunConfig.for_task(name).model_dump(exclude=changed)
    assert all(config.model_dump(exclude=changed) == preset for config in plan(name))


def test_pan_tilt_has_the_parameters_of_section_six() -> None:
    for config in plan("pan-tilt"):
        assert (config.hidden_units, config.alpha, config.beta) == (100, 0.95, 3.0)
        assert (config.iterations, config.steps) == (150, 80)


def test_targets_share_runs() -> None:
    tracking = {config_hash(config) for config in plan("tracking")}
    assert {config_hash(config) for config in plan("latency")} <= tracking
    # the three N that heat map and curves have in common, at the preset's alpha
    reaching = {config_hash(config) for config in plan("reaching")}
    assert len(reaching & {config_hash(config) for config in plan("heatmap")}) == 3 * 5


@pytest.mark.parametrize("name", TARGETS)
def test_quick_runs_are_tiny_and_never_those_of_the_real_thing(name: str) -> None:
    quick = plan(name, 2, quick=True)
    assert len(quick) <= 8
    assert all(config.iterations * config.episodes * config.steps <= 100 for config in quick)
    real = {config_hash(config) for config in plan(name)}
    assert real.isdisjoint(config_hash(config) for config in quick)


def test_iterations_are_the_presets_unless_given() -> None:
    for name in set(TARGETS) - {"inference", "averaging"}:  # which need no run
        configs = TARGETS[name].plan(Scope(1, TARGETS[name].algorithms, iterations=7))
        assert {config.iterations for config in configs} == {7}
        assert 7 not in {config.iterations for config in plan(name)}


@pytest.mark.parametrize("name", ["reaching", "tracking", "heatmap", "pan-tilt", "robustness"])
def test_seeds_begin_where_they_are_told(name: str) -> None:
    target = TARGETS[name]
    configs = target.plan(Scope(2, target.algorithms, first_seed=20))
    assert {config.seed for config in configs} == {20, 21}
    known = {config_hash(config) for config in plan(name)}
    assert known.isdisjoint(config_hash(config) for config in configs)


def test_fewer_algorithms_are_fewer_runs() -> None:
    configs = TARGETS["tracking"].plan(Scope(2, ("cvi",)))
    assert [(config.algorithm, config.seed) for config in configs] == [("cvi", 0), ("cvi", 1)]


def test_only_the_wanted_sizes_are_planned() -> None:
    scope = Scope(seeds=2, algorithms=("bpn", "cvi"), hidden_units=(256,))
    assert [(run.algorithm, run.hidden_units) for run in TARGETS["tracking"].plan(scope)] == [
        ("bpn", 256),
        ("cvi", 256),
    ] * 2
    assert {run.hidden_units for run in TARGETS["heatmap"].plan(scope)} == {256}


def test_a_size_that_the_target_does_not_have_is_named() -> None:
    with pytest.raises(ConfigError, match="--hidden-units = 17 is none of 32, 100, 256"):
        TARGETS["reaching"].plan(Scope(seeds=1, algorithms=("bpn",), hidden_units=(17,)))
