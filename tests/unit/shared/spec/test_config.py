import math
from itertools import pairwise
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from paper import TASKS
from pydantic import TypeAdapter, ValidationError

from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.tasks import TaskSpec

TABLE_ONE = {
    "alpha": 0.95, "beta": 1, "gamma": 0.99, "epochs": 50, "batch_size": 32, "iterations": 50,
    "episodes": 10, "steps": 20, "replay_iterations": 3,
}  # fmt: skip


@pytest.mark.parametrize(
    ("task", "differences"),
    [
        ("reaching", {}),
        ("tracking", {"steps": 40}),
        ("pan_tilt", {"hidden_units": 100, "beta": 3, "iterations": 150, "steps": 80}),
    ],
)
def test_presets_are_the_papers_where_it_gives_values(
    task: str, differences: dict[str, Any]
) -> None:
    config = RunConfig.for_task(task)
    expected = TABLE_ONE | differences
    assert {name: getattr(config, name) for name in expected} == expected
    assert config.bootstrap_terminals  # Algorithm 1 as printed
    of_task = config.task_spec
    assert (config.frame_channels, config.frames_stacked, config.frame_skip, config.actions) == (
        of_task.frame_channels,
        of_task.frames_stacked,
        1,
        of_task.actions,
    )


@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_every_task_has_a_preset_and_observations_of_its_network(task: TaskSpec) -> None:
    config = RunConfig.for_task(task.name)
    assert task.preset["steps"] == config.steps
    assert config.network.channels == task.frame_channels * task.frames_stacked
    assert config.network.actions == task.actions > task.hold_action
    assert task.control_period_s == 0.145


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"alpha": 1.5}, "alpha = 1.5: Input should be less than or equal to 1"),
        ({"beta": 0}, "beta = 0: Input should be greater than 0"),
        ({"hidden_units": "many"}, "hidden_units = 'many': Input should be a valid integer"),
        ({"pacing": "slow"}, "pacing = 'slow': Input should be 'lockstep' or 'realtime'"),
        (
            {"task": "flying"},
            "task = 'flying': unknown; one of: arm, gym:[MODULE:]ENVIRONMENT-ID, pan_tilt",
        ),
        (
            {"algorithm": "sarsa"},
            "algorithm = 'sarsa': algorithm 'sarsa' is not installed here; there are: bpn, bqn",
        ),
        (
            {"algorithm": "dpp", "alpha": 0.9},
            "alpha = 0.9: algorithm 'dpp' has alpha = 1; leave alpha out",
        ),
        (
            {"algorithm": "cvi", "kernel": "native"},
            "kernel = 'native' does not run the network of 'cvi'",
        ),
        ({"kernel": "onnx"}, "does not run the network of 'bpn', which is binary; one of: native"),
        (
            {"algorithm": "cvi", "kernel": "rtl"},
            "kernel = 'rtl' does not run the network of 'cvi'",
        ),
        (
            {"kernel": "rtl", "conv": "8x4x8,4x2x16"},
            "kernel = 'rtl' is a circuit of the paper's convolutions over 84 px, this run has "
            "conv = '8x4x8,4x2x16' over 84 px: choose another kernel, or leave it out",
        ),
        ({"frames_stacked": 4}, "frames_stacked = 4: task 'reaching' has 1; leave it out"),
        ({"frame_px": 64}, "frame_px = 64: task 'reaching' has 84; leave it out"),
        (
            {"task": "gym:A-v1", "actions": 2, "frame_px": 7},
            "frame_px = 7 is outside 8..128",
        ),
        ({"conv": "8x4"}, "conv = '8x4': '8x4' is no layer: each is KERNELxSTRIDExCHANNELS"),
        (
            {"conv": "8x4x16,4x5x8"},
            "conv = '8x4x16,4x5x8' with frames of 84 x 84: convolutions: layer 2 (4x5x8), stride = 5",
        ),
        (
            {"task": "gym:A-v1", "actions": 2, "frame_px": 12, "conv": "8x4x8,4x2x16"},
            "with frames of 12 x 12: convolutions: layer 2 (4x2x16): its kernel is larger than its input, 2 x 2",
        ),
        ({"conv": "1x1x100"}, "weights, at most 4,000,000 are allowed"),
        ({"actions": 3}, "actions = 3: task 'reaching' has 14"),
        (
            {"task": "gym:CartPole-v1", "actions": 0},
            "actions = 0: give the number of actions of 'gym:Cart",
        ),
        ({"task": "gym:A-v1", "actions": 1}, "actions = 1: give the number of actions"),
        ({"task": "gym:A-v1", "actions": 2, "frame_channels": 2}, "must be 1 (gray) or 3 (RGB)"),
        (
            {"task": "gym:A-v1", "actions": 2, "frame_channels": 3, "frames_stacked": 6},
            "frames_stacked = 6 of 3 channels: an observation has at most 16",
        ),
        (
            {"task": "gym:A-v1", "actions": 2, "pacing": "realtime"},
            "pacing = 'realtime': 'gym:A-v1' has no clock of its own; choose lockstep",
        ),
        (
            {"task": "gym:A-v1", "actions": 2, "disturb": "noise=5,backlash=3"},
            "a Gymnasium environment has no servos with backlash; leave it out",
        ),
        ({"task": "gym:"}, "task = 'gym:': must be gym:[MODULE:]ENVIRONMENT-ID"),
        ({"task": "gym"}, "task = 'gym': unknown; gym:[MODULE:]ENVIRONMENT-ID is what gym has"),
        ({"task": "reaching:far"}, "task = 'reaching:far': unknown; reaching is what reaching has"),
        ({"task_spec": {}}, "task_spec: follows from the name; one of: task, algorithm"),
        ({"task": "gym:a b", "actions": 2}, "gym:[MODULE:]ENVIRONMENT-ID"),
        ({"task": "gym:a-b:C-v0", "actions": 2}, "gym:[MODULE:]ENVIRONMENT-ID"),
        ({"task": "gym:a..b:C-v0", "actions": 2}, "gym:[MODULE:]ENVIRONMENT-ID"),
        ({"alhpa": 0.5}, "alhpa = 0.5: unknown; one of: task, algorithm"),
        ({"crop": "0,0,9,9"}, "crop = '0,0,9,9': task 'reaching' is no Gymnasium environment"),
        ({"difference": True}, "difference = True: task 'reaching' is no Gymnasium environment"),
    ],
)
def test_a_wrong_value_names_itself_and_its_range(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as error:
        RunConfig.for_task(**{"task": "reaching", **changes})
    assert message in str(error.value)


def test_a_gym_environment_is_a_task_by_its_name() -> None:
    config = RunConfig.for_task("gym:space/Some-v3", actions=5, frame_channels=3, frames_stacked=4)
    task = config.task_spec
    assert (task.name, task.actions, task.frame_shape) == ("gym:space/Some-v3", 5, (3, 84, 84))
    assert (config.network.channels, config.network.actions) == (12, 5)
    assert (task.rewards, task.return_metric, task.return_unit) == (None, "return", "")
    assert not config.bootstrap_terminals
    assert RunConfig.from_json(config.model_dump_json().encode(), source="x") == config
    assert RunConfig.for_task("gym:A-v0", actions="2").network.channels == 2


def test_a_papers_task_says_what_it_has() -> None:
    config = RunConfig.for_task("tracking", frames_stacked="0")  # 0: as the task has it
    assert (config.frame_channels, config.frames_stacked, config.actions) == (3, 2, 7)
    assert (config.task_spec.return_metric, config.task_spec.return_unit) == ("return_px", " px")


@given(st.binary(max_size=200))
def test_noise_for_json_is_a_config_error(noise: bytes) -> None:
    with pytest.raises(ConfigError, match="file"):
        RunConfig.from_json(b"[" + noise, source="file")  # no JSON object begins so


@given(st.integers(0, 49), st.integers(0, 2**62))
def test_json_gives_the_same_configuration(iteration: int, seed: int) -> None:
    config = RunConfig.for_task("reaching", seed=seed, algorithm="bqn")
    assert RunConfig.from_json(config.model_dump_json().encode(), source="x") == config
    assert config.epsilon_final <= config.epsilon(iteration) <= config.epsilon_initial


@pytest.mark.parametrize(
    ("name", "network", "targets"),
    [
        ("bpn", "binary", "cvi"),
        ("bqn", "binary", "dqn"),
        ("cvi", "float", "cvi"),
        ("dqn", "float", "dqn"),
        ("dpp", "float", "cvi"),
    ],
)
def test_an_algorithm_is_a_network_and_targets(name: str, network: str, targets: str) -> None:
    for config in (
        RunConfig.bare("reaching", algorithm=name),
        RunConfig.for_task("pan_tilt", algorithm=name),
    ):
        assert (config.algorithm_spec.network, config.algorithm_spec.targets) == (network, targets)
        assert config.kernel == "", "whatever an edge has"
        assert config.alpha == (1.0 if name == "dpp" else 0.95)
        assert RunConfig.from_json(config.model_dump_json().encode(), source="x") == config


@pytest.mark.parametrize(
    ("name", "explores"),
    [("bpn", False), ("bqn", True), ("cvi", False), ("dqn", True), ("dpp", False)],
)
def test_only_dqn_explores_with_epsilon(name: str, explores: bool) -> None:
    config = RunConfig.bare("reaching", algorithm=name, iterations=50)
    expected = [1.0, 0.05, 0.05] if explores else [0, 0, 0]
    assert [config.epsilon(i) for i in (0, 25, 49)] == pytest.approx(expected)


@given(st.integers(1, 200), st.floats(0, 1))
def test_the_rate_falls_linearly_over_the_run(iterations: int, last: float) -> None:
    config = RunConfig.bare("reaching", iterations=iterations, lr_run_final_factor=last)
    shares = [config.learning_rate_share(i) for i in range(iterations)]
    assert shares[0] == 1
    assert shares == sorted(shares, reverse=True)
    if iterations > 1:
        assert shares[-1] == pytest.approx(last)


BY_VALUE = {"task_spec", "algorithm_spec"}
DEFAULTS: dict[str, Any] = {
    "env_kwargs": "", "env_wrappers": "", "frames_from": "auto", "observation_key": "", "crop": "",
    "max_over_frames": 1, "difference": False, "action_bins": 0, "action_dims": "", "frame_px": 84,
    "conv": "8x4x8,4x2x16,3x1x16", "disturb": "", "beta_run_final_factor": 1.0, "n_step": 1, "gap_floor": 0.0,
    "replay_transitions": 0, "max_updates": 0, "augment": "",
    "task": "reaching", "algorithm": "bpn", "seed": 0, "frame_channels": 1, "frames_stacked": 1,
    "frame_skip": 1, "actions": 14, "iterations": 50, "episodes": 10, "steps": 20, "epochs": 50,
    "batch_size": 32, "replay_iterations": 3, "alpha": 0.95, "beta": 1.0, "gamma": 0.99,
    "bootstrap_terminals": True, "relative_targets": False, "epsilon_initial": 1.0, "epsilon_final": 0.05,
    "hidden_units": 100,
    "learning_rate": 1e-3, "lr_update_final_factor": 0.02, "lr_run_final_factor": 0.1,
    "scale_initial": 0.2, "reward_scale": 0.1, "backend": "native", "learners": 1, "device": "cpu",
    "tensorboard": False, "init_from": "",
    "evaluate_every": 0, "evaluate_episodes": 10, "stop_when": "", "callbacks": "",
    "robots": 1, "pacing": "lockstep", "action_delay_ms": 0.0, "kernel": "", "algorithm_options": "",
}  # fmt: skip
_FRAMED = {
    "frame_channels": 3,
    "frames_stacked": 2,
    "relative_targets": True,
    "lr_run_final_factor": 0.05,
}
PRESET_VALUES: dict[str, dict[str, Any]] = {
    "reaching": {"hidden_units": 256, "relative_targets": True, "lr_run_final_factor": 0.05},
    "tracking": {**_FRAMED, "actions": 7, "steps": 40, "hidden_units": 256, "reward_scale": 0.2},
    "pan_tilt": {**_FRAMED, "actions": 17, "iterations": 150, "steps": 80, "beta": 3.0},
    "gym:CartPole-v1": {
        "frames_stacked": 2, "frame_skip": 3, "actions": 2, "iterations": 30, "episodes": 60,
        "steps": 100, "epochs": 10, "replay_iterations": 6, "alpha": 0.9, "gamma": 0.9,
        "bootstrap_terminals": False, "relative_targets": True, "hidden_units": 256, "learning_rate": 3e-3,
        "scale_initial": 0.05, "reward_scale": 0.6,
    },
    "gym:Other-v0": {
        "frames_stacked": 2, "actions": 5, "steps": 200, "bootstrap_terminals": False, "reward_scale": 0.0,
        "scale_initial": 0.0, "hidden_units": 256, "relative_targets": True, "n_step": 8, "episodes": 20,
        "replay_transitions": 20_000, "max_updates": 500,
    },
}  # fmt: skip


@pytest.mark.parametrize("task", PRESET_VALUES)
def test_every_default_and_preset_is_what_published_runs_were_made_with(task: str) -> None:
    """A value that changes makes other weights of the same command."""
    given = {"actions": 5} if task == "gym:Other-v0" else {}
    expected = DEFAULTS | {"task": task} | PRESET_VALUES[task]
    assert RunConfig.for_task(task, **given).model_dump(exclude=BY_VALUE) == expected


def test_without_its_preset_a_task_has_the_fields_defaults() -> None:
    assert RunConfig.bare("reaching").model_dump(exclude=BY_VALUE) == DEFAULTS


@given(st.integers(1, 60), st.integers(0, 59), st.floats(0, 1), st.floats(0, 1))
def test_epsilon_falls_on_a_line_over_half_of_the_run(
    iterations: int, iteration: int, initial: float, final: float
) -> None:
    config = RunConfig.bare(
        "reaching",
        algorithm="dqn",
        iterations=iterations,
        epsilon_initial=initial,
        epsilon_final=final,
    )
    share = min(1.0, iteration / (iterations / 2))
    assert config.epsilon(iteration) == pytest.approx((1 - share) * initial + share * final)
    assert RunConfig.bare("reaching", iterations=iterations).epsilon(iteration) == 0


@given(st.integers(2, 60), st.floats(0, 1))
def test_the_learning_rate_falls_on_a_line_over_the_run(iterations: int, last: float) -> None:
    config = RunConfig.bare("reaching", iterations=iterations, lr_run_final_factor=last)
    shares = [config.learning_rate_share(iteration) for iteration in range(iterations)]
    assert shares[0] == 1
    assert shares[-1] == pytest.approx(last)
    steps = [b - a for a, b in pairwise(shares)]
    assert steps == pytest.approx([(last - 1) / (iterations - 1)] * (iterations - 1))
    assert (
        RunConfig.bare("reaching", iterations=1, lr_run_final_factor=last).learning_rate_share(0)
        == 1
    )


@given(st.integers(2, 60), st.floats(0.1, 10), st.floats(1, 100))
def test_beta_rises_on_a_line_over_the_run_and_stays(
    iterations: int, beta: float, factor: float
) -> None:
    config = RunConfig.bare(
        "reaching", iterations=iterations, beta=beta, beta_run_final_factor=factor
    )
    betas = [config.beta_of(version) for version in range(iterations + 1)]
    assert betas[0] == beta
    assert betas[-2] == betas[-1] == pytest.approx(factor * beta)
    steps = [b - a for a, b in pairwise(betas[:-1])]
    assert steps == pytest.approx([beta * (factor - 1) / (iterations - 1)] * (iterations - 1))
    level = RunConfig.bare("reaching", iterations=iterations, beta=beta)
    assert {level.beta_of(version) for version in range(iterations + 1)} == {beta}


RANGES: dict[str, tuple[float, float]] = {
    "frame_px": (0, 128),
    "seed": (0, 2**63 - 1), "frame_channels": (0, 3), "frames_stacked": (0, 16), "frame_skip": (0, 100),
    "actions": (0, 64), "iterations": (1, 100_000), "episodes": (1, 10_000), "steps": (1, 1000),
    "epochs": (1, 10_000), "batch_size": (2, 4096), "replay_iterations": (1, 1000), "hidden_units": (1, 1024),
    "learners": (1, 64),
    "max_over_frames": (1, 100), "action_bins": (0, 64), "evaluate_every": (0, 100_000),
    "evaluate_episodes": (1, 1000), "n_step": (1, 100),
    "beta_run_final_factor": (1, 1000), "gap_floor": (0, 1e6),
    "replay_transitions": (0, 10_000_000), "max_updates": (0, 10_000_000),
    "robots": (1, 64), "alpha": (0, 1), "epsilon_initial": (0, 1), "epsilon_final": (0, 1),
    "scale_initial": (0, 100), "reward_scale": (0, 1000),
    "lr_update_final_factor": (0, 1), "lr_run_final_factor": (0, 1), "action_delay_ms": (0, 2000),
    # above 0
    "beta": (math.ulp(0), 1e4), "learning_rate": (math.ulp(0), 1),
    # below 1
    "gamma": (0, math.nextafter(1, 0)),
}  # fmt: skip


def test_every_number_has_a_range() -> None:
    numbers = {name for name, f in RunConfig.model_fields.items() if f.annotation in (int, float)}
    assert numbers == RANGES.keys()


@pytest.mark.parametrize("name", RANGES)
def test_a_number_may_be_all_of_its_range_and_nothing_else(name: str) -> None:
    field = RunConfig.model_fields[name]
    adapter: TypeAdapter[float] = TypeAdapter(Annotated[field.annotation, *field.metadata])
    low, high = RANGES[name]
    assert adapter.validate_python(low) == low
    assert adapter.validate_python(high) == high
    whole = field.annotation is int
    below, above = (low - 1, high + 1) if whole else (
        math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
    )  # fmt: skip
    for value in (below, above, math.nan):
        with pytest.raises(ValidationError):
            adapter.validate_python(value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("[" * 3000, "recursion"),
        ('{"a": ' * 3000, "recursion"),
        ('{"a": 1e999}', "1e999 is too large a number"),
        ('{"a": [-1e999]}', "-1e999 is too large a number"),
    ],
)
def test_options_of_an_algorithm_that_no_file_could_hold_are_refused(
    given: str, message: str
) -> None:
    with pytest.raises(ConfigError, match="algorithm_options") as refused:
        RunConfig.for_task("reaching", algorithm_options=given)
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("period_s", "pacing", "expected_s"),
    [(0.145, "realtime", 1), (0.4, "realtime", 2), (60, "realtime", 300), (60, "lockstep", 1)],
)
def test_robot_and_edge_may_be_silent_for_some_control_periods(
    period_s: float, pacing: str, expected_s: float
) -> None:
    config = RunConfig.for_task("reaching", pacing=pacing)
    task = config.task_spec.model_copy(update={"control_period_s": period_s})
    slow = config.model_copy(update={"task_spec": task})
    assert slow.longest_silence_s == pytest.approx(expected_s)
