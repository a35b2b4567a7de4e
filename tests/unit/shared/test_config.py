from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.config import PRESETS, ConfigError, RunConfig
from bpn_shared.tasks import TASKS, Task


def test_the_reaching_preset_is_table_one() -> None:
    config = RunConfig.for_task("reaching")
    table = {
        "alpha": 0.95, "beta": 1, "gamma": 0.99, "epochs": 50, "batch": 32, "iterations": 50,
        "episodes": 10, "steps": 20, "datasets": 3,
    }  # fmt: skip
    assert {name: getattr(config, name) for name in table} == table
    assert not config.mask_terminals  # Algorithm 1 as printed


@pytest.mark.parametrize(
    ("task", "differences"),
    [
        ("tracking", {"nodes": 100, "steps": 40, "reward_scale": 0.2}),
        (
            "pan_tilt",
            {
                "nodes": 100,
                "alpha": 0.95,
                "beta": 3,
                "iterations": 150,
                "steps": 80,
                "reward_scale": 0.2,
            },
        ),
    ],
)
def test_the_other_presets_are_table_one_but_for(task: str, differences: dict[str, Any]) -> None:
    reaching = RunConfig.for_task("reaching").model_dump()
    assert RunConfig.for_task(task).model_dump() == reaching | {"task": task} | differences


@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_every_task_has_a_preset_and_observations_of_its_network(task: Task) -> None:
    config = RunConfig.for_task(task.name)
    assert task.name in PRESETS
    assert config.network.channels == task.frame_channels * task.frames_stacked
    assert config.network.actions == task.actions > task.hold_action
    assert task.control_period_s == 0.145


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"alpha": 1.5}, "alpha = 1.5: Input should be less than or equal to 1"),
        ({"beta": 0}, "beta = 0: Input should be greater than 0"),
        ({"nodes": "many"}, "nodes = 'many': Input should be a valid integer"),
        ({"pacing": "slow"}, "pacing = 'slow': Input should be 'lockstep' or 'realtime'"),
        ({"task": "flying"}, "task = 'flying': task = 'flying' is unknown; one of: reaching"),
        ({"alhpa": 0.5}, "alhpa = 0.5: unknown; one of: task, algorithm"),
    ],
)
def test_a_wrong_value_names_itself_and_its_range(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as error:
        RunConfig.for_task(**{"task": "reaching", **changes})
    assert message in str(error.value)


@given(st.binary(max_size=200))
def test_noise_for_json_is_a_config_error(noise: bytes) -> None:
    with pytest.raises(ConfigError, match="file"):
        RunConfig.from_json(b"[" + noise, source="file")  # no JSON object begins so


@given(st.integers(0, 49), st.integers(0, 2**62))
def test_json_gives_the_same_configuration(iteration: int, seed: int) -> None:
    config = RunConfig.for_task("reaching", seed=seed, algorithm="bqn")
    assert RunConfig.from_json(config.model_dump_json().encode(), source="x") == config
    assert config.epsilon_final <= config.epsilon(iteration) <= config.epsilon_initial


def test_only_dqn_explores_with_epsilon() -> None:
    assert RunConfig(algorithm="bpn").epsilon(0) == 0
    bqn = RunConfig(algorithm="bqn", iterations=50)
    assert [bqn.epsilon(i) for i in (0, 25, 49)] == pytest.approx([1.0, 0.05, 0.05])


@given(st.integers(1, 200), st.floats(0, 1))
def test_the_rate_falls_linearly_over_the_run(iterations: int, last: float) -> None:
    config = RunConfig(iterations=iterations, learning_rate_last=last)
    shares = [config.learning_rate_share(i) for i in range(iterations)]
    assert shares[0] == 1
    assert shares == sorted(shares, reverse=True)
    if iterations > 1:
        assert shares[-1] == pytest.approx(last)


def test_relative_targets_and_masked_terminals_exclude_each_other() -> None:
    with pytest.raises(ConfigError, match="relative_targets = True with mask_terminals = True"):
        RunConfig.for_task("tracking", relative_targets=True, mask_terminals=True)
