"""Every layer of the simulated core beside the golden model."""

from pathlib import Path

import numpy as np
import pytest

from bpn.testing.kernel import assert_exact, check_kernel, make_image
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.device import Device
from bpn_edge.fpga.simulated import SimulatedCore
from bpn_edge.kernel.device_bank import DeviceBank
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.spec.network import NetworkSpec

LARGEST = NetworkSpec(16, 256, 64)
TRAINED = sorted((Path(__file__).parents[1] / "golden").glob("schema-*/*/weights/*.bpnw"))


@pytest.mark.timeout(3600)
def test_random_and_adversarial_networks(device: Device, scale: int) -> None:
    check_kernel(DeviceBank("rtl", device), networks=20 * scale, seed=scale, largest=LARGEST)


def test_with_gaps_everywhere(core: SimulatedCore, scale: int) -> None:
    core.dawdle(pixels=150, weights=150, registers=150)
    check_kernel(DeviceBank("rtl", Device(core)), networks=4 * scale, seed=7, largest=LARGEST)


@pytest.mark.parametrize("hidden_units", [1, 15, 16, 17, 32, 33, 100, 255, 256])
def test_sizes_at_the_engines_seams(device: Device, hidden_units: int) -> None:
    rng = np.random.default_rng(hidden_units)
    for channels, actions in ((1, 2), (6, 17), (3, 64)):
        spec = NetworkSpec(channels, hidden_units, actions)
        assert_exact(
            DeviceBank("rtl", device), WeightBlob.random(spec, rng), make_image("random", spec, rng)
        )


def test_trained_weights(device: Device) -> None:
    assert TRAINED
    for path in TRAINED:
        blob = WeightBlob.decode(path.read_bytes())
        for image in ("random", "zeros", "full", "black and white"):
            assert_exact(
                DeviceBank("rtl", device),
                blob,
                make_image(image, blob.spec, np.random.default_rng(0)),
            )


@pytest.mark.parametrize("pixel_bytes", [1, 2, 8, 16])
def test_other_builds(pixel_bytes: int, scale: int) -> None:
    if scale == 1 and pixel_bytes in {1, 2, 16}:
        pixel_bytes = 8  # one more model is enough for every day
    build = Build(pixel_bytes=pixel_bytes, channels=6, hidden_units=100, actions=17)
    device = Device(SimulatedCore(build))
    assert device.build == build
    rng = np.random.default_rng(pixel_bytes)
    for spec in (NetworkSpec(6, 100, 17), NetworkSpec(1, 16, 2), NetworkSpec(5, 33, 16)):
        assert_exact(
            DeviceBank("rtl", device), WeightBlob.random(spec, rng), make_image("random", spec, rng)
        )


def test_a_network_beyond_the_build_is_refused(device: Device) -> None:
    rng = np.random.default_rng(0)
    kernel = DeviceBank("rtl", device)
    with pytest.raises(BlobError, match=r"N = 257 is more than the 256"):
        kernel.load(WeightBlob.random(NetworkSpec(1, 257, 2), rng))


def test_clocks_are_the_streams_own(core: SimulatedCore) -> None:
    """At most 400 clocks after the last pixels; frames back to back cost what the stream costs, and one clock."""
    spec = NetworkSpec(6, 100, 17)
    device = Device(core)
    blob = WeightBlob.random(spec, np.random.default_rng(0))
    device.load(0, blob)
    device.run(0, spec, spec.probe())
    clocks, tail = device.clocks()
    assert clocks == 10_584 + tail
    assert tail <= 400
