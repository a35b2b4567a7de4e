import json
from pathlib import Path
from typing import Any

import pytest

from bpn_shared.runs.config_file import (
    SCHEMA,
    OtherConfigVersionError,
    config_hash,
    config_schema,
    config_writer,
    decode_config,
    encode_config,
    raw_config,
    sections,
)
from bpn_shared.runs.digests import seal
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.installed import preset_of
from bpn_shared.spec.sections import AlgorithmValues, ExecutionValues, TrainingValues
from bpn_shared.version import VERSION, written_by

GOLDEN = Path(__file__).parents[3] / "golden"
CONFIG = RunConfig.for_task("tracking", seed=9, lr_run_final_factor=0.25)


def test_it_says_who_wrote_it() -> None:
    data = encode_config(CONFIG)
    assert decode_config(data, source="config.json") == CONFIG
    assert config_writer(data) == written_by()
    assert config_writer(data)["version"] == VERSION
    assert config_writer(data)["python"].count(".") == 2
    assert json.loads(data)["schema"] == SCHEMA == config_schema(data)


@pytest.mark.parametrize(("schema", "path"), [
    (1, next(GOLDEN.glob("schema-1/*/config.json"))),
    (2, GOLDEN / "config-2.json"),
    (3, GOLDEN / "config-3.json"),
    (4, GOLDEN / "config-4.json"),
])  # fmt: skip
def test_every_schema_is_read_for_ever(schema: int, path: Path) -> None:
    data = path.read_bytes()
    config = decode_config(data, source=str(path))
    expected = RunConfig.bare("reaching", seed=5, iterations=5, episodes=2, steps=2, epochs=2, batch_size=2,
        hidden_units=1, replay_iterations=2,
        **{k: v for k, v in preset_of("reaching").items() if k not in ("steps", "hidden_units")},
    )  # fmt: skip
    assert (config, config_schema(data)) == (expected, schema)


def test_what_an_old_file_does_not_say_is_what_was_done_then() -> None:
    old = {"task": "reaching", "learning_rate_last": 0.1, "kernel": "native"}
    config = decode_config(json.dumps(old).encode(), source="old")
    assert (config.lr_update_final_factor, config.backend, config.hidden_units) == (1, "torch", 100)
    assert config.model_fields_set == set(RunConfig.model_fields), "a default of today stands in"


OLD = {"task": "reaching", "algorithm": "dqn", "kernel": "onnx", "nodes": 7, "batch": 4, "datasets": 2,
       "learning_rate_final": 0.5, "learning_rate_last": 0.25, "engine": "fast",
       "mask_terminals": True}  # fmt: skip


def test_names_of_before_are_todays() -> None:
    config = decode_config(json.dumps(OLD).encode(), source="old")
    assert config == RunConfig.bare(
        "reaching", algorithm="dqn", hidden_units=7, batch_size=4, replay_iterations=2, backend="native",
        lr_update_final_factor=0.5, lr_run_final_factor=0.25, bootstrap_terminals=False,
    )  # fmt: skip
    assert raw_config(json.dumps(OLD).encode())["hidden_units"] == 7


@pytest.mark.parametrize(("algorithm", "kernel", "asked"), [
    ("bpn", "native", ""), ("bpn", "golden", "golden"), ("bpn", "mine", "mine"), ("cvi", "onnx", ""),
])  # fmt: skip
def test_an_old_run_asks_for_a_kernel_where_it_had_another_than_all(
    algorithm: str, kernel: str, asked: str
) -> None:
    old = {"task": "reaching", "algorithm": algorithm, "kernel": kernel}
    assert decode_config(json.dumps(old).encode(), source="old").kernel == asked


def test_it_has_sections_and_task_and_algorithm_by_value() -> None:
    document = json.loads(encode_config(CONFIG))
    assert list(document) == [
        "schema", "written_by", "task", "algorithm", "training", "execution", "sha256",
    ]  # fmt: skip
    assert document["task"] == CONFIG.task_spec.model_dump(mode="json")
    assert document["algorithm"].items() >= {"name": "bpn", "targets": "cvi", "options": {}}.items()
    assert (document["training"]["seed"], document["execution"]["kernel"]) == (9, "")
    assert "hidden_units" not in document["execution"]


LEARNED = {"alpha": 0.5, "seed": 8, "algorithm": "bqn", "reward_scale": 0.3, "pacing": "realtime"}
DONE = {"kernel": "golden", "backend": "torch", "device": "cuda", "learners": 2, "robots": 3,
        "tensorboard": True, "evaluate_every": 2, "evaluate_episodes": 3, "callbacks": "x"}  # fmt: skip


def test_the_hash_is_of_what_is_learned_alone() -> None:
    assert DONE.keys() == ExecutionValues.model_fields.keys()
    of = config_hash(CONFIG)
    for name, value in DONE.items():
        assert config_hash(CONFIG.model_copy(update={name: value})) == of, name
    others = [config_hash(RunConfig.for_task("tracking", **{"seed": 9, name: value}))
              for name, value in LEARNED.items()]  # fmt: skip
    others.append(config_hash(RunConfig.for_task("reaching", seed=9)))
    assert len({of, *others}) == 2 + len(LEARNED)


def test_old_runs_and_new_equal_ones_have_one_hash() -> None:
    paths = [next(GOLDEN.glob("schema-1/*/config.json"))] + [
        GOLDEN / f"config-{schema}.json" for schema in (2, 3)
    ]
    old = [decode_config(path.read_bytes(), source=str(path)) for path in paths]
    new = RunConfig.for_task("reaching", **{
        name: getattr(old[0], name) for name in (*AlgorithmValues.model_fields, *TrainingValues.model_fields)
    })  # fmt: skip
    assert {config_hash(config) for config in (*old, new)} == {config_hash(new)}


def test_the_shape_is_part_of_what_is_learned() -> None:
    gym = {"task": "gym:Some-v0", "actions": 3}
    hashes = {
        config_hash(RunConfig.for_task(**gym, **changes))
        for changes in ({}, {"conv": "8x4x8,4x2x16,3x1x17"}, {"frame_px": 64})
    }
    assert len(hashes) == 3
    same = RunConfig.for_task(**gym, conv=" 8x4x8,4x2x16, 3x1x16", frame_px=84)
    assert config_hash(same) in hashes


def changed(**values: Any) -> bytes:
    document = json.loads(encode_config(CONFIG))
    del document["sha256"]
    return seal(document | values)


def test_another_version_is_told_from_damage_and_its_values_can_be_shown() -> None:
    later = {"schema": 7, "written_by": {"version": "9.1"}, "training": {"warp": 1}}
    later |= {"task": {"name": "x"}, "algorithm": {}, "execution": {}}
    more = {"training": sections(CONFIG)["training"] | {"warp": 1}}
    for data, what in (
        (seal(later), "schema 7, written by bpn 9.1"),
        (changed(**more), "warp unknown"),
    ):
        with pytest.raises(OtherConfigVersionError, match=f"{what}.*this is bpn {VERSION}"):
            decode_config(data, source="config.json")
        assert raw_config(data)["warp"] == 1


def one_less() -> bytes:
    values = sections(CONFIG)["algorithm"]
    del values["gamma"]
    return changed(algorithm=values)


EDITED = encode_config(CONFIG).replace(b'"seed": 9', b'"seed": 8')


@pytest.mark.parametrize(("data", "reason"), [
    (EDITED, "changed after it was written.*; put the file back as it was, or start a new run"),
    (encode_config(CONFIG).replace(b'"sha256"', b'"sha255"'), "lost its sha256"),
    (encode_config(CONFIG).replace(b'"schema"', b'"scheme"'), "changed after"),
    (one_less(), "gamma missing"),
    (changed(schema=0), "schema = 0"),
    (changed(schema="2"), "schema = '2'"),
    (changed(execution=[1]), "no values"),
    (b'{"task": "reaching", "alpha": 2}', "alpha = 2: .*less than or equal to 1"),
    (b'{"task": "reaching", "alpha": 0.5, "beta2": 1}', "beta2 = 1: unknown"),
    (b"\xff\x00", "no JSON"),
    (b'{"alpha": 0.5}', "schema 1 tells the task by its name: task = None is no name"),
    (b'{"task": "juggling"}', r"task = 'juggling': unknown; one of: arm, gym:\[MODULE:\]ENVIRONMENT-ID, pan_tilt"),
    (b"", "no JSON"),
])  # fmt: skip
def test_a_damaged_or_edited_file_is_refused_in_one_line(data: bytes, reason: str) -> None:
    with pytest.raises(ConfigError, match=rf"^runs/config\.json: .*{reason}") as raised:
        decode_config(data, source="runs/config.json")
    assert "\n" not in str(raised.value)
    assert not isinstance(raised.value, OtherConfigVersionError)
