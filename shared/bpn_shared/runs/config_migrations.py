"""From the values of older config.json schemas to today's, step by step.

What a file does not say is what the program did that wrote it, never what is the default today.
"""

from collections.abc import Callable
from typing import Any

from bpn_shared.errors import InputError
from bpn_shared.spec.algorithms import KERNELS, find_algorithm
from bpn_shared.spec.installed import task_spec
from bpn_shared.spec.network import PAPER_CONVOLUTIONS, format_convolutions
from bpn_shared.spec.renamed import renamed
from bpn_shared.spec.tasks import TaskOptions

Values = dict[str, Any]

_BEFORE_SCHEMA_2: Values = {
    # The defaults of schema 1, and for what its first programs did not have yet, what they did.
    "algorithm": "bpn",
    "seed": 0,
    "frame_channels": 0,
    "frames_stacked": 0,
    "frame_skip": 0,
    "actions": 0,
    "iterations": 50,
    "episodes": 10,
    "steps": 20,
    "epochs": 50,
    "batch": 32,
    "datasets": 3,
    "alpha": 0.95,
    "beta": 1.0,
    "gamma": 0.99,
    "mask_terminals": False,
    "relative_targets": False,
    "epsilon_initial": 1.0,
    "epsilon_final": 0.05,
    "nodes": 100,
    "learning_rate": 1e-3,
    "learning_rate_final": 1.0,
    "learning_rate_last": 1.0,
    "scale_initial": 0.2,
    "reward_scale": 0.1,
    "engine": "plain",
    "learners": 1,
    "device": "cpu",
    "tensorboard": False,
    "robots": 1,
    "pacing": "lockstep",
    "action_delay_ms": 0.0,
}

_BEFORE_SCHEMA_3: Values = {
    "init_from": "",
    "evaluate_every": 0,
    "evaluate_episodes": 10,
    "stop_when": "",
    "callbacks": "",
    "env_kwargs": "",
    "env_wrappers": "",
    "frames_from": "auto",
    "observation_key": "",
    "crop": "",
    "max_over_frames": 1,
    "difference": False,
    "action_bins": 0,
}
"""Values of files from before there were these options: all off."""


_BEFORE_SCHEMA_4: Values = {
    "n_step": 1,
    "gap_floor": 0.0,
    "replay_transitions": 0,
    "max_updates": 0,
    "disturb": "",
}
_BEFORE_SCHEMA_5: Values = {"beta_run_final_factor": 1.0, "augment": "", "action_dims": ""}
"""The same."""


def _from_1(values: Values) -> Values:
    return _BEFORE_SCHEMA_2 | values


def _from_2(values: Values) -> Values:
    name = values.get("task")
    if not isinstance(name, str):
        raise InputError(f"tells the task by its name: task = {name!r} is no name")
    try:
        spec = task_spec(name, _task_options(values))
    except InputError as error:
        raise InputError(f"tells the task by its name: {error}") from error
    return _BEFORE_SCHEMA_3 | values | {"task_spec": spec.model_dump(mode="json")}


def _from_3(values: Values) -> Values:
    """Today's names; the paper's convolutions, and frames of the task's size; the algorithm by value.

    And no kernel where a run had the only one that there was.
    """
    found = _BEFORE_SCHEMA_4 | renamed(values)
    name = str(found.get("algorithm"))
    spec = find_algorithm(name).spec
    found |= {"conv": format_convolutions(PAPER_CONVOLUTIONS), "frame_px": 0}
    found |= {"algorithm_spec": spec.model_dump(mode="json"), "algorithm_options": ""}
    if found.get("kernel") == KERNELS[spec.network][0]:
        found["kernel"] = ""
    of_task = found.get("task_spec")
    if isinstance(of_task, dict) and isinstance(of_task.get("preset"), dict):
        found["task_spec"] = of_task | {"preset": renamed(of_task["preset"])}
    return found


def _from_4(values: Values) -> Values:
    return _BEFORE_SCHEMA_5 | values


MIGRATIONS: dict[int, Callable[[Values], Values]] = {1: _from_1, 2: _from_2, 3: _from_3, 4: _from_4}
"""From a schema's values to those of the next one; each raises InputError where they cannot be."""


def _task_options(values: Values) -> TaskOptions:
    """Of an impossible one, what the task has: it is refused for itself."""
    found: Values = {}
    for name in TaskOptions.model_fields:
        if name in values:
            try:
                found |= TaskOptions.model_validate({name: values[name]}).model_dump(include={name})
            except ValueError:
                continue
    return TaskOptions(**found)
