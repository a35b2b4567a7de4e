"""config.json: the configuration of a run, with its schema, who wrote it and a digest.

Schema 1 was the values alone; in schema 2 the task was a name, and there were neither callbacks nor warm starts.
Each older schema is migrated to the next one, step by step, and what a file does not say is what the program did
that wrote it, never what is the default today.
"""

from collections.abc import Callable
from typing import Any

from bpn_shared.errors import InputError
from bpn_shared.runs.digests import DamagedError, seal, unseal
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.installed import task_spec
from bpn_shared.spec.tasks import TaskOptions
from bpn_shared.version import VERSION, written_by

SCHEMA = 3

_REMEDY = "put the file back as it was, or start a new run with the values that you want"


class OtherConfigVersionError(ConfigError):
    """The configuration was written by another version, which this program cannot stand in for."""


def encode_config(config: RunConfig) -> bytes:
    """The bytes of config.json."""
    return seal(
        {"schema": SCHEMA, "written_by": written_by(), "config": config.model_dump(mode="json")}
    )


def decode_config(data: bytes, *, source: str) -> RunConfig:
    """Reads `encode_config`'s bytes, and those of older schemas.

    Raises:
        OtherConfigVersionError: a newer schema, or keys that this program does not know.
        ConfigError: damaged, changed by hand, or of an older schema with a task that is not installed here.
    """
    document = _document(data, source)
    schema = _schema(document, source)
    values = document if schema == 1 else document.get("config")
    if not isinstance(values, dict):
        raise ConfigError(f"{source}: it has no values; {_REMEDY}")
    for older in range(schema, SCHEMA):
        values = _migrated(older, values, f"{source}: schema {schema}")
    values = _AS_PRINTED | values
    unknown = values.keys() - RunConfig.model_fields.keys()
    if unknown and schema > 1:
        raise OtherConfigVersionError(
            f"{source}: {', '.join(sorted(unknown))} unknown here, {_whose(document)}"
        )
    missing = RunConfig.model_fields.keys() - values.keys()
    if missing and schema > 1:
        raise ConfigError(f"{source}: {', '.join(sorted(missing))} missing; {_REMEDY}")
    return RunConfig.parse(values, source=source)


def raw_config(data: bytes) -> dict[str, Any]:
    """The values as they stand in the file, whatever wrote it, for showing; {} if they cannot be read."""
    try:
        document = _document(data, "")
    except ConfigError:
        return {}
    values = document.get("config", document)
    return values if isinstance(values, dict) else {}


def config_writer(data: bytes) -> dict[str, Any]:
    """Who wrote the file; {} if it does not say."""
    try:
        found = _document(data, "").get("written_by")
    except ConfigError:
        return {}
    return found if isinstance(found, dict) else {}


def config_schema(data: bytes) -> int:
    """The schema of a file; of one that cannot be read, this program's."""
    try:
        return _schema(_document(data, ""), "")
    except OtherConfigVersionError:
        return SCHEMA + 1
    except ConfigError:
        return SCHEMA


def _document(data: bytes, source: str) -> dict[str, Any]:
    try:
        document, has_digest = unseal(data)
    except DamagedError as error:
        raise ConfigError(f"{source}: {error}; {_REMEDY}") from error
    if not has_digest and "schema" in document:
        raise ConfigError(f"{source}: it has lost its sha256; {_REMEDY}")
    return document


def _schema(document: dict[str, Any], source: str) -> int:
    schema = document.get("schema", 1)
    if type(schema) is not int or schema < 1:
        raise ConfigError(f"{source}: schema = {schema!r} is no number from 1 on; {_REMEDY}")
    if schema > SCHEMA:
        raise OtherConfigVersionError(f"{source}: schema {schema}, {_whose(document)}")
    return schema


def _whose(document: dict[str, Any]) -> str:
    writer = document.get("written_by")
    version = writer.get("version", "?") if isinstance(writer, dict) else "?"
    return f"written by bpn {version}; this is bpn {VERSION}: use the version that wrote it"


_BEFORE_SCHEMA_2: dict[str, Any] = {
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


_AS_PRINTED: dict[str, Any] = {
    "n_step": 1,
    "gap_floor": 0.0,
    "replay_transitions": 0,
    "max_updates": 0,
    "disturb": "",
}
"""Values of files from before there were these options: all off."""


def _migrated(older: int, values: dict[str, Any], source: str) -> dict[str, Any]:
    try:
        return _MIGRATIONS[older](values)
    except InputError as error:
        raise ConfigError(f"{source} tells the task by its name: {error}") from error


def _from_1(values: dict[str, Any]) -> dict[str, Any]:
    return _BEFORE_SCHEMA_2 | values


BEFORE_SCHEMA_3: dict[str, Any] = {
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


def _from_2(values: dict[str, Any]) -> dict[str, Any]:
    name = values.get("task")
    if not isinstance(name, str):
        raise InputError(f"task = {name!r} is no name; {_REMEDY}")
    return BEFORE_SCHEMA_3 | values | {"task_spec": task_spec(name, _task_options(values))}


def _task_options(values: dict[str, Any]) -> TaskOptions:
    """Of an impossible one, what the task has: it is refused for itself."""
    found: dict[str, Any] = {}
    for name in TaskOptions.model_fields:
        if name in values:
            try:
                found |= TaskOptions.model_validate({name: values[name]}).model_dump(include={name})
            except ValueError:
                continue
    return TaskOptions(**found)


_MIGRATIONS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {1: _from_1, 2: _from_2}
