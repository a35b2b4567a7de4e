"""The C export: compiles without a warning, and gives the golden model's integers on every layer."""

import ast
import tempfile
from pathlib import Path

import numpy as np
import pytest
from compiled import compiled, expected, ran
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import SPECS, awkward_blob, awkward_observation

from bpn.export.c_source import c_source
from bpn_shared.spec.installed import task_spec
from bpn_shared.spec.network import NetworkSpec
from bpn_shared.spec.tasks import TaskOptions, TaskSpec

TASK = task_spec("reaching", TaskOptions())


def named(spec: NetworkSpec, names: list[str]) -> TaskSpec:
    return TASK.model_copy(update={"action_names": tuple(names[: spec.actions])})


@settings(max_examples=15)
@given(spec=SPECS, seed=st.integers(0, 2**32 - 1))
def test_every_layer_is_exact(spec: NetworkSpec, seed: int) -> None:
    rng = np.random.default_rng(seed)
    blob = awkward_blob(spec, rng)
    observations = [awkward_observation(spec, rng) for _ in range(3)]
    source = c_source(blob, named(spec, [f"action {index}" for index in range(64)]))
    with tempfile.TemporaryDirectory() as folder:
        found = ran(compiled(source, Path(folder)), observations)
    for observation, row in zip(observations, found, strict=True):
        np.testing.assert_array_equal(row, expected(blob, observation))


def test_names_cannot_break_out_of_the_file(tmp_path: Path) -> None:
    blob = awkward_blob(NetworkSpec(1, 3, 4), np.random.default_rng(1))
    names = ['"; */ int x; /* "', "??/ \\ %s \n", "größer 3°", "*/"]
    task = named(blob.spec, names).model_copy(update={"name": "gym:*/#error"})
    source = c_source(blob, task)
    observation = awkward_observation(blob.spec, np.random.default_rng(2))
    program = compiled(source, tmp_path)
    np.testing.assert_array_equal(ran(program, [observation])[0], expected(blob, observation))
    text = source.partition("bpn_action_names[BPN_ACTIONS] = {")[2].partition("};")[0]
    lines = [line.strip().rstrip(",") for line in text.strip().splitlines()]
    read = [ast.literal_eval(f"b{line}").decode() for line in lines]
    assert read == names


@pytest.mark.parametrize("word", ["malloc", "calloc", "free(", "float ", "double"])
def test_it_has_neither_heap_nor_floating_point_but_lambda(word: str) -> None:
    source = c_source(awkward_blob(NetworkSpec(1, 3, 4), np.random.default_rng(1)), TASK)
    lines = [line for line in source.splitlines() if word in line]
    assert all("bpn_scale" in line for line in lines)
