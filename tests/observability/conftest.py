import shutil
from pathlib import Path

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    no_prometheus = pytest.mark.skipif(
        shutil.which("promtool") is None or shutil.which("prometheus") is None,
        reason="no prometheus; `make test-observability` installs it or says how",
    )
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(no_prometheus)
