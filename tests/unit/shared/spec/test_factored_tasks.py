"""Tasks whose actions have several dimensions: numbers, choices and names of one action agree."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.errors import InputError
from bpn_shared.runs.config_file import config_hash, decode_config, encode_config
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.joint_actions import format_dims, joined, parse_dims
from bpn_shared.spec.tasks import TaskSpec

OURS = {"reaching_both": (7, 7), "pan_tilt_both": (5, 5), "arm": (7, 7, 7, 7)}
dims_of = st.lists(st.integers(2, 6), min_size=2, max_size=8)


def task_of(dims: list[int], **changes: Any) -> TaskSpec:
    names = tuple(f"{d}: {choice}" for d, n in enumerate(dims) for choice in range(n))
    values = {"name": "some", "robot": "some", "frame_channels": 1, "control_period_s": 0.1}
    return TaskSpec(**values | {"action_names": names, "action_dims": dims} | changes)


@given(dims_of, st.data())
def test_an_actions_number_choices_and_name_are_the_same_action(dims: list[int], data: Any) -> None:
    task = task_of(dims)
    choices = [data.draw(st.integers(0, n - 1)) for n in dims]
    action = joined(choices, dims)
    assert task.choices(action) == tuple(choices)
    assert task.action_name(action) == ", ".join(f"{d}: {c}" for d, c in enumerate(choices))
    assert (task.actions, task.joint_actions) == (
        sum(dims),
        joined([n - 1 for n in dims], dims) + 1,
    )
    assert task.network(8).action_dims == tuple(dims)


@given(dims_of)
def test_dimensions_as_text_are_read_back(dims: list[int]) -> None:
    assert parse_dims(format_dims(dims)) == tuple(dims)


@pytest.mark.parametrize("text", ["3,1", "3;3", "a,b", "3,,3", "3,100", "-3,3", "³,3"])
def test_what_is_no_list_of_choices_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no number of choices"):
        parse_dims(text)


def test_one_dimension_has_no_list() -> None:
    assert parse_dims("") == parse_dims(" ") == parse_dims("7") == ()
    plain = RunConfig.for_task("reaching").task_spec
    assert (plain.action_dims, plain.dims, plain.joint_actions) == ((), (14,), 14)
    assert plain.action_name(3) == plain.action_names[3]
    assert plain.network(8).action_dims == (14,)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"action_dims": (2, 2)},
            r"action_dims = \[2, 2\]: they have to be several, and 5 together",
        ),
        ({"action_dims": (5,)}, r"action_dims = \[5\]: they have to be several"),
        ({"hold_action": 6}, r"hold_action = 6: there are the actions 0\.\.5"),
    ],
)
def test_dimensions_that_do_not_fit_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        task_of([2, 3], **changes)


@pytest.mark.parametrize("name", OURS)
def test_our_factored_tasks_hold_by_turning_nothing(name: str) -> None:
    config = RunConfig.for_task(name)
    task = config.task_spec
    assert task.dims == OURS[name]
    assert config.action_dims == format_dims(OURS[name])
    held = task.action_name(task.hold_action).split(", ")
    assert len(held) == len(task.dims)
    assert all(turn.endswith(" by 0°") for turn in held)


def test_a_factored_runs_configuration_is_read_back() -> None:
    for config in (RunConfig.for_task("arm"), RunConfig.for_task("gym:Some-v0", action_dims="3,4")):
        assert decode_config(encode_config(config), source="here") == config
        assert config.task_spec.actions == config.actions


def test_a_gym_task_has_the_dimensions_that_it_is_given() -> None:
    config = RunConfig.for_task("gym:Some-v0", action_dims="3, 4")
    assert (config.action_dims, config.actions, config.task_spec.dims) == ("3,4", 7, (3, 4))
    assert config.task_spec.action_name(6) == "action 0: 1, action 1: 2"
    plain = RunConfig.for_task("gym:Some-v0", actions=7)
    assert plain.task_spec.dims == (7,)
    assert config_hash(plain) != config_hash(config)


@pytest.mark.parametrize(
    ("task", "changes", "message"),
    [
        (
            "gym:Some-v0",
            {"action_dims": "3,4", "actions": 6},
            "are 7 choices together, actions = 6",
        ),
        (
            "gym:Some-v0",
            {"action_dims": "40,40"},
            "are 80 choices together, a policy has at most 64",
        ),
        ("arm", {"action_dims": "7,7"}, "action_dims = .*task 'arm' has 7,7,7,7; leave it out"),
        ("reaching", {"action_dims": "7,7"}, "action_dims = .*task 'reaching' has"),
    ],
)
def test_dimensions_that_a_task_has_not_are_refused(
    task: str, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        RunConfig.for_task(task, **changes)
