"""Runs that are alike, as groups with names that tell them apart."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bpn_dashboard.database.tables import RunRow
from bpn_shared.spec.sections import ExecutionValues

GroupBy = list[str] | Literal["all_but_seed"] | None

_ANY = frozenset({"seed", *ExecutionValues.model_fields})
"""In which runs that are alike may differ."""


@dataclass(frozen=True)
class Group:
    """Runs that form one curve.

    Attributes:
        key: the same for the same group whatever else is shown: for colours.
        values: of the configuration keys that say which group it is.
        seeds: of its runs, by their ids.
    """

    key: str
    label: str
    values: dict[str, Any]
    seeds: dict[str, int]


def group_runs(runs: Sequence[RunRow], group_by: GroupBy) -> list[Group]:
    """The groups, in order of their oldest runs.

    With "all_but_seed", runs are alike whose learning is, wherever and with what it was done, and a group is named
    by those values alone in which it differs from another.
    """
    if group_by is None:
        return [Group(run.id, run.name, {}, {run.id: run.seed}) for run in runs]
    members: dict[str, list[RunRow]] = {}
    for run in runs:
        members.setdefault(_key(run, group_by), []).append(run)
    first = [group[0].config for group in members.values()]
    shown = group_by
    if group_by == "all_but_seed":
        keys = [key for key in first[0] if key not in _ANY] if first else []
        shown = [key for key in keys if any(c.get(key) != first[0][key] for c in first)]
    groups = []
    for key, group in members.items():
        values = {name: group[0].config.get(name) for name in shown}
        label = " ".join(f"{name}={value}" for name, value in values.items())
        label = label or f"{group[0].task} {group[0].algorithm}"
        groups.append(Group(key, label, values, {run.id: run.seed for run in group}))
    return groups


def _key(run: RunRow, group_by: list[str] | Literal["all_but_seed"]) -> str:
    if group_by == "all_but_seed":
        values = {key: value for key, value in run.config.items() if key not in _ANY}
    else:
        values = {key: run.config.get(key) for key in group_by}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]
