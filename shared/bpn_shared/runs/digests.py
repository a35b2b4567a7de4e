"""Digests of what rests on disk: written with it, checked when it is read.

A JSON document has one over its values as its last key, so it may be laid out anew but not changed; a line of JSON
has a short one over the bytes before it. Checkpoints have one over their arrays; weights and episodes are messages
with digests of their own.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NoReturn

_KEY = "sha256"
_LINE_DIGITS = 16
_SEALED_LINE = re.compile(rb'(\{.*), "sha256": "([0-9a-f]{%d})"\}' % _LINE_DIGITS, re.DOTALL)
_MAX_DEPTH = 32


class DamagedError(ValueError):
    """What rests on disk is not what was written; the message says in what way."""


def seal(values: Mapping[str, Any]) -> bytes:
    """A JSON document with its digest.

    Raises:
        ValueError: a number is not finite.
    """
    sealed = {**values, _KEY: _digest(values)}
    return json.dumps(sealed, indent=2, allow_nan=False).encode() + b"\n"


def unseal(data: bytes) -> tuple[dict[str, Any], bool]:
    """The values of a JSON document, and whether it bears a digest, which then is right.

    Raises:
        DamagedError: no JSON object, or not the one that was written.
    """
    values = _parse(data)
    if _KEY not in values:
        return values, False
    found = values.pop(_KEY)
    if found != _digest(values):
        raise DamagedError("it was changed after it was written: its sha256 is another one")
    return values, True


def seal_line(record: Mapping[str, Any]) -> bytes:
    """A record as a line of JSON with its digest, without a newline.

    Raises:
        ValueError: a number is not finite, or the record is empty.
    """
    if not record:
        raise ValueError("a line needs something to say")
    body = json.dumps(record, allow_nan=False).encode()[:-1]
    return body + f', "{_KEY}": "{_line_digest(body)}"}}'.encode()


def unseal_line(line: bytes) -> tuple[dict[str, Any], bool]:
    """A line's record, and whether it bears a digest, which then is right.

    Raises:
        DamagedError: no JSON object, or not the one that was written.
    """
    has_digest = check_line(line)
    record = _parse(line)
    return {name: value for name, value in record.items() if name != _KEY}, has_digest


def check_line(line: bytes) -> bool:
    """Whether a line bears a digest, which then is right; for readers with a parser of their own.

    Raises:
        DamagedError: it is not what was written.
    """
    match = _SEALED_LINE.fullmatch(line)
    if match is not None and match[2].decode() != _line_digest(match[1]):
        raise DamagedError("it was changed after it was written: its sha256 is another one")
    return match is not None


def arrays_digest(arrays: Iterable[tuple[str, str, Sequence[int], bytes]]) -> str:
    """SHA-256 (hex) over arrays as (name, dtype, shape, bytes), in the order of their names."""
    digest = hashlib.sha256()
    for name, dtype, shape, data in sorted(arrays):
        head = json.dumps([name, dtype, list(shape), len(data)]).encode()
        digest.update(len(head).to_bytes(4, "little") + head)
        digest.update(data)
    return digest.hexdigest()


def _digest(values: Mapping[str, Any]) -> str:
    canonical = json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()


def _line_digest(body: bytes) -> str:
    return hashlib.sha256(body).hexdigest()[:_LINE_DIGITS]


def _parse(data: bytes) -> dict[str, Any]:
    try:
        values = json.loads(data, parse_constant=_refuse, parse_float=_finite)
    except (ValueError, RecursionError) as error:  # of bytes, syntax, numbers, depth
        raise DamagedError(f"no JSON: {error}") from error
    if not isinstance(values, dict):
        raise DamagedError(f"a {type(values).__name__} where an object is expected")
    _check_depth(values, _MAX_DEPTH)
    return values


def _check_depth(value: Any, left: int) -> None:
    if left == 0:
        raise DamagedError(f"nested more than {_MAX_DEPTH} deep")
    for inner in value.values() if isinstance(value, dict) else value:
        if isinstance(inner, (dict, list)):
            _check_depth(inner, left - 1)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number")


def _finite(text: str) -> float:
    value = float(text)
    if value in (float("inf"), float("-inf")):
        raise ValueError(f"{text[:20]} is beyond what a float holds")
    return value
