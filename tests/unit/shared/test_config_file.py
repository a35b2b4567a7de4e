import json
from pathlib import Path
from typing import Any

import pytest

from bpn_shared.runs.config_file import (
    SCHEMA,
    OtherConfigVersionError,
    config_schema,
    config_writer,
    decode_config,
    encode_config,
    raw_config,
)
from bpn_shared.runs.digests import seal
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.installed import preset_of
from bpn_shared.version import VERSION, written_by

GOLDEN = Path(__file__).parents[2] / "golden"
CONFIG = RunConfig.for_task("tracking", seed=9, learning_rate_last=0.25)


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
])  # fmt: skip
def test_every_schema_is_read_for_ever(schema: int, path: Path) -> None:
    data = path.read_bytes()
    config = decode_config(data, source=str(path))
    expected = RunConfig.bare("reaching", seed=5, iterations=5, episodes=2, steps=2, epochs=2, batch=2, nodes=1,
        datasets=2, **{k: v for k, v in preset_of("reaching").items() if k not in ("steps", "nodes")},
    )  # fmt: skip
    assert (config, config_schema(data)) == (expected, schema)


def test_what_an_old_file_does_not_say_is_what_was_done_then() -> None:
    old = {"task": "reaching", "learning_rate_last": 0.1, "kernel": "native"}
    config = decode_config(json.dumps(old).encode(), source="old")
    assert (config.learning_rate_final, config.engine, config.nodes) == (1.0, "plain", 100)
    assert config.model_fields_set == set(RunConfig.model_fields), "a default of today stands in"


def changed(**values: Any) -> bytes:
    document = json.loads(encode_config(CONFIG))
    del document["sha256"]
    return seal(document | values)


def test_another_version_is_told_from_damage_and_its_values_can_be_shown() -> None:
    later = {"schema": 7, "written_by": {"version": "9.1"}, "config": {"task": "x", "warp": 1}}
    more = {"config": CONFIG.model_dump() | {"warp": 1}}
    for data, what in (
        (seal(later), "schema 7, written by bpn 9.1"),
        (changed(**more), "warp unknown"),
    ):
        with pytest.raises(OtherConfigVersionError, match=f"{what}.*this is bpn {VERSION}"):
            decode_config(data, source="config.json")
        assert raw_config(data)["warp"] == 1


def one_less() -> bytes:
    values = CONFIG.model_dump()
    del values["gamma"]
    return changed(config=values)


EDITED = encode_config(CONFIG).replace(b'"seed": 9', b'"seed": 8')


@pytest.mark.parametrize(("data", "reason"), [
    (EDITED, "changed after it was written.*; put the file back as it was, or start a new run"),
    (encode_config(CONFIG).replace(b'"sha256"', b'"sha255"'), "lost its sha256"),
    (encode_config(CONFIG).replace(b'"schema"', b'"scheme"'), "changed after"),
    (one_less(), "gamma missing"),
    (changed(schema=0), "schema = 0"),
    (changed(schema="2"), "schema = '2'"),
    (changed(config=[1]), "no values"),
    (b'{"task": "reaching", "alpha": 2}', "alpha = 2: .*less than or equal to 1"),
    (b'{"task": "reaching", "alpha": 0.5, "beta2": 1}', "beta2 = 1: unknown"),
    (b"\xff\x00", "no JSON"),
    (b'{"alpha": 0.5}', "schema 1 tells the task by its name: task = None is no name"),
    (b'{"task": "juggling"}', r"task = 'juggling': unknown; one of: gym:\[MODULE:\]ENVIRONMENT-ID, pan_tilt"),
    (b"", "no JSON"),
])  # fmt: skip
def test_a_damaged_or_edited_file_is_refused_in_one_line(data: bytes, reason: str) -> None:
    with pytest.raises(ConfigError, match=rf"^runs/config\.json: .*{reason}") as raised:
        decode_config(data, source="runs/config.json")
    assert "\n" not in str(raised.value)
    assert not isinstance(raised.value, OtherConfigVersionError)
