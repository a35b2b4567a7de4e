"""What parts of one's own must be able to do, as checks that raise `AssertionError`; our own pass them."""

from bpn.testing.kernel import check_kernel
from bpn.testing.robot import check_robot
from bpn.testing.task import check_task

__all__ = ["check_kernel", "check_robot", "check_task"]
