"""What one module has logged: services on threads of the same process log, too."""

from collections.abc import Callable
from typing import Any

import pytest


def lines(caplog: pytest.LogCaptureFixture, of: Callable[..., Any]) -> list[str]:
    """The messages, in order, of the module that this class or function is from."""
    return [record.getMessage() for record in caplog.records if record.name == of.__module__]
