"""Values of a configuration that had another name once: what wrote it then is read, who still says it is told."""

from collections.abc import Mapping
from typing import Any

RENAMED = {
    "nodes": "hidden_units",
    "batch": "batch_size",
    "datasets": "replay_iterations",
    "learning_rate_final": "lr_update_final_factor",
    "learning_rate_last": "lr_run_final_factor",
    "engine": "backend",
    "mask_terminals": "bootstrap_terminals",
}
"""Names of before configuration schema 4, and what they are called now."""

_BACKENDS = {"fast": "native", "plain": "torch"}
_NOTES = {
    "engine": " (fast is native, plain is torch)",
    "mask_terminals": ", the opposite of it",
}


def called_now(name: str) -> str | None:
    """For errors: what became of an old name; None if it is none."""
    new = RENAMED.get(name)
    return None if new is None else f"is called {new} now{_NOTES.get(name, '')}"


def renamed(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values under today's names; those that have them stay as they are."""
    return {RENAMED.get(name, name): _value(name, value) for name, value in values.items()}


def renamed_grid(grid: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    """`renamed` of a sweep's axes."""
    return {
        RENAMED.get(name, name): [_value(name, value) for value in values]
        for name, values in grid.items()
    }


def _value(name: str, value: Any) -> Any:
    if name == "engine":
        return _BACKENDS.get(value, value) if isinstance(value, str) else value
    if name == "mask_terminals" and isinstance(value, bool):
        return not value
    return value
