"""Values of a run as a command's options."""

from collections.abc import Mapping


def flags(values: Mapping[str, object]) -> list[str]:
    """`hidden_units` 8 is `--hidden-units 8`; the task is none."""
    return [
        word
        for name, value in values.items()
        if name != "task"
        for word in (f"--{name.replace('_', '-')}", str(value))
    ]
