import pytest
from hypothesis import given
from hypothesis import strategies as st
from paper import TASKS

from bpn_dashboard.registry.sweeps import expand
from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_shared.spec.config import ConfigError, RunConfig

AXES = {
    "alpha": st.floats(0, 1),
    "hidden_units": st.integers(1, 500),
    "algorithm": st.sampled_from(["bpn", "bqn"]),
    "task": st.sampled_from(list(TASKS)),
}
GRIDS = st.fixed_dictionaries(
    {}, optional={k: st.lists(v, min_size=1, max_size=3, unique=True) for k, v in AXES.items()}
)


@given(grid=GRIDS, seeds=st.lists(st.integers(0, 2**63 - 1), max_size=3, unique=True))
def test_every_combination_is_there_once_and_each_is_the_preset_with_that_change(
    grid: dict[str, list[object]], seeds: list[int]
) -> None:
    runs = expand({"task": "tracking", "iterations": 7}, grid, seeds, ConnectedWorkers())
    count = 1
    for values in [*grid.values(), seeds or [0]]:
        count *= len(values)
    assert (
        len({run.config for run in runs}) == len({run.name for run in runs}) == len(runs) == count
    )
    for run in runs:
        point = {key: getattr(run.config, key) for key in grid}
        assert all(point[key] in values for key, values in grid.items())
        changes = {"task": "tracking", "iterations": 7, "seed": run.config.seed} | point
        assert run.config == RunConfig.for_task(changes.pop("task"), **changes)
        assert run.config.seed in (seeds or [0])


@pytest.mark.parametrize(
    ("config", "grid", "seeds", "message"),
    [
        ({}, {"alhpa": [1]}, [], "grid: alhpa: unknown; one of: .*task, algorithm, seed"),
        ({}, {"alpha": [0.5, 2]}, [], "alpha = 2: Input should be less than or equal to 1"),
        ({}, {"alpha": []}, [], "grid: alpha: no values"),
        ({}, {"alpha": [0.5, 0.5]}, [], "grid: alpha = 0.5: stands there twice"),
        ({}, {}, [1, 1], "seed = 1: stands there twice"),
        ({}, {"seed": [1]}, [2], "the seeds are given already"),
        ({"node": 1}, {}, [], "node = 1: unknown"),
        ({"task": "flying"}, {}, [], r"task = 'flying': unknown; one of: arm, gym:\[MODULE:\]ENVIRONMENT-ID, "),
        ({}, {"hidden_units": list(range(1, 101)), "batch_size": list(range(2, 22))}, [], "2000 runs, the limit"),
    ],
)  # fmt: skip
def test_errors_name_key_and_value(
    config: dict[str, object], grid: dict[str, list[object]], seeds: list[int], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        expand({"task": "reaching", **config}, grid, seeds, ConnectedWorkers())


def test_a_sweep_needs_a_task() -> None:
    with pytest.raises(ConfigError, match="task: missing"):
        expand({}, {"alpha": [0.5]}, [], ConnectedWorkers())
    assert len(expand({}, {"task": ["reaching", "tracking"]}, [], ConnectedWorkers())) == 2
