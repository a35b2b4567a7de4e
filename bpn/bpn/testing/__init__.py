"""What parts of one's own must be able to do, as checks that raise `AssertionError`; our own pass them."""

from bpn.testing.kernel import check_kernel

__all__ = ["check_kernel"]
