"""config.json: the configuration of a run in sections, with its schema, who wrote it and a digest.

Schema 1 was the values alone; in schema 2 the task was a name, and there were neither callbacks nor warm starts;
up to schema 3 all values stood beside each other, some under other names, and the algorithm was a name. The same
bytes are what a run's learner tells its workers.
"""

import hashlib
import json
from typing import Any

from bpn_shared.errors import InputError
from bpn_shared.runs.config_migrations import MIGRATIONS
from bpn_shared.runs.digests import DamagedError, seal, unseal
from bpn_shared.spec.algorithms import AlgorithmSpec
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.renamed import renamed
from bpn_shared.spec.sections import ADDED, LEARNED, SECTIONS
from bpn_shared.spec.tasks import TaskOptions
from bpn_shared.version import VERSION, written_by

SCHEMA = 5

_REMEDY = "put the file back as it was, or start a new run with the values that you want"
_SHOWN = {"title", "plot", "preset"}
"""Of a task's specification: what people see, and what a run began with."""


class OtherConfigVersionError(ConfigError):
    """The configuration was written by another version, which this program cannot stand in for."""


def encode_config(config: RunConfig) -> bytes:
    """The bytes of config.json."""
    return seal({"schema": SCHEMA, "written_by": written_by(), **sections(config)})


def sections(config: RunConfig) -> dict[str, dict[str, Any]]:
    """The configuration as config.json has it, by section."""
    algorithm = config.algorithm_spec.model_dump(mode="json")
    of = {
        name: config.model_dump(mode="json", include=set(values.model_fields))
        for name, values in SECTIONS.items()
    }
    del of["algorithm"]["algorithm_options"]
    of["algorithm"] = algorithm | of["algorithm"] | {"options": config.own_options}
    return {"task": config.task_spec.model_dump(mode="json"), **of}


def config_hash(config: RunConfig) -> str:
    """SHA-256 of what is learned: equal for runs that differ in their execution alone.

    A value of the task that is its field's default is left out, and so is one of the training that came later, so
    that a new field changes no hash.
    """
    learned: dict[str, Any] = {name: sections(config)[name] for name in LEARNED}
    for section, added in ADDED.items():
        for name in added:
            if getattr(config, name) == RunConfig.model_fields[name].default:
                del learned[section][name]
    learned["task"] = config.task_spec.model_dump(
        mode="json", exclude=_SHOWN, exclude_defaults=True
    )
    for shown in ("title", "preset", "fixed"):
        del learned["algorithm"][shown]
    return hashlib.sha256(json.dumps(learned, sort_keys=True).encode()).hexdigest()


def decode_config(data: bytes, *, source: str) -> RunConfig:
    """Reads `encode_config`'s bytes, and those of older schemas.

    Raises:
        OtherConfigVersionError: a newer schema, or keys that this program does not know.
        ConfigError: damaged, changed by hand, or of an older schema with a task that is not installed here.
    """
    document = _document(data, source)
    schema = _schema(document, source)
    values = _values(document, schema)
    if values is None:
        raise ConfigError(f"{source}: it has no values; {_REMEDY}")
    for older in range(schema, SCHEMA):
        try:
            values = MIGRATIONS[older](values)
        except InputError as error:
            raise ConfigError(f"{source}: schema {schema} {error}; {_REMEDY}") from error
    unknown = values.keys() - RunConfig.model_fields.keys()
    if unknown and schema > 1:
        raise OtherConfigVersionError(
            f"{source}: {', '.join(sorted(unknown))} unknown here, {_whose(document)}"
        )
    missing = RunConfig.model_fields.keys() - values.keys() - TaskOptions.model_fields.keys()
    if missing and schema > 1:
        raise ConfigError(f"{source}: {', '.join(sorted(missing))} missing; {_REMEDY}")
    return RunConfig.parse(values, source=source)


def raw_config(data: bytes) -> dict[str, Any]:
    """The values as they stand in the file, whatever wrote it, for showing; {} if they cannot be read."""
    try:
        document = _document(data, "")
        schema = document.get("schema", 1)
        values = _values(document, schema if type(schema) is int else SCHEMA)
    except ConfigError:
        return {}
    return renamed(values or {})


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


def _values(document: dict[str, Any], schema: int) -> dict[str, Any] | None:
    """The values of a document, flat, under the names of its schema; None: it has none."""
    if schema < 4:
        found = document if schema == 1 else document.get("config")
        return found if isinstance(found, dict) else None
    parts = {name: document.get(name) for name in ("task", *SECTIONS)}
    if not all(isinstance(part, dict) for part in parts.values()):
        return None
    task, algorithm = dict(parts.pop("task") or {}), dict(parts.pop("algorithm") or {})
    values = {"task": task.get("name"), "task_spec": task}
    values |= _of_algorithm(algorithm)
    for part in parts.values():
        values |= part or {}
    return values


def _of_algorithm(section: dict[str, Any]) -> dict[str, Any]:
    values = {name: v for name, v in section.items() if name not in AlgorithmSpec.model_fields}
    own = values.pop("options", None)
    if isinstance(own, dict):
        values["algorithm_options"] = json.dumps(own, sort_keys=True) if own else ""
    spec = {name: v for name, v in section.items() if name in AlgorithmSpec.model_fields}
    return values | {"algorithm": spec.get("name"), "algorithm_spec": spec}


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
