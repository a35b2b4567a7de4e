import os
from collections.abc import Iterator

import pytest

from bpn_edge.fpga.build import Build
from bpn_edge.fpga.device import Device
from bpn_edge.fpga.simulated import SimulatedCore


@pytest.fixture(scope="session")
def scale() -> int:
    """How many times as much `make test-rtl` does."""
    return int(os.environ.get("BPN_RTL_SCALE", "1"))


@pytest.fixture
def core() -> Iterator[SimulatedCore]:
    """A simulated core of the usual build; its model is made once, in half a minute."""
    core = SimulatedCore(Build(), seed=1)
    yield core
    core.close()


@pytest.fixture
def device(core: SimulatedCore) -> Device:
    return Device(core)
