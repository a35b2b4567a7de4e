"""One dashboard at a time uses a state folder: two would write each other's database and address."""

import contextlib
import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path

from bpn_shared.spec.config import ConfigError

ADDRESS_FILE = ".dashboard.json"
"""In the state folder: where the dashboard is, and a token for this user's commands."""
_LOCK_FILE = ".dashboard.lock"


@contextlib.contextmanager
def state_lock(folder: Path) -> Iterator[None]:
    """Holds the lock of a state folder while the body runs.

    Raises:
        ConfigError: another dashboard holds it, or there is no writing there.
    """
    path = folder / _LOCK_FILE
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; give a --state-dir to write to") from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise ConfigError(
            f"{folder} is in use by {_holder(folder)}: stop it, or give another --state-dir"
        ) from None
    try:
        yield
    finally:
        os.close(descriptor)


def _holder(folder: Path) -> str:
    try:
        address = json.loads((folder / ADDRESS_FILE).read_bytes())
        return f"the dashboard at {address['url']} (pid {address['pid']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another dashboard, which is just starting"
