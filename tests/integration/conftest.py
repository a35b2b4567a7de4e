from collections.abc import Callable
from typing import Any

import pytest

# Small, but through every part: 4 iterations so that D holds old and new data.
OPTIONS = [
    "--iterations",
    "4",
    "--episodes",
    "12",
    "--epochs",
    "2",
    "--hidden-units",
    "24",
    "--replay-iterations",
    "2",
]


@pytest.fixture(scope="session")
def small() -> list[str]:
    """Options of a run that takes seconds."""
    return OPTIONS


@pytest.fixture(scope="session")
def undisturbed(train: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    """The run that all others with the same seed must equal."""
    return train("reaching", "--seed", "5", *OPTIONS)
