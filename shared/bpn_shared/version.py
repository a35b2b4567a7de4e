"""Which program this is, and which protocol it speaks."""

from importlib.metadata import version
from typing import Final

VERSION: Final = version("bpn-shared")
PROTOCOL: Final = 2
"""Of everything that travels between services. It rises when services of before and after cannot work together:
the registry gives no place to a worker with another one, and says so."""
