"""Several machines with networks of their own; not part of `make test`: minutes, and root."""

import os
from pathlib import Path

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.timeout(900))
            if "BPN_MACHINES" not in os.environ:
                item.add_marker(pytest.mark.skip(reason="machines: run `make test-machines`"))
