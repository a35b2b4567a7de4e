"""Disks that are full, without a disk."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_file_grows(beyond_bytes: int = 0) -> Iterator[None]:
    """As on a full disk, no file of this process can grow; names still can be made, moved and removed.

    Args:
        beyond_bytes: up to this size they can.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (beyond_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
