"""Policies as the core's words, and back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn.testing.kernel import with_edge_thresholds
from bpn_edge.fpga import packing
from bpn_edge.fpga.build import Build, engine_words, groups
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.spec.network import NetworkSpec

SPECS = st.builds(NetworkSpec, st.integers(1, 16), st.integers(1, 256), st.integers(2, 64))
BUILDS = st.builds(Build, st.sampled_from([1, 2, 4, 8, 16]), keeps_frame=st.booleans())


@settings(max_examples=30)
@given(SPECS, BUILDS, st.integers(0, 2**32 - 1))
def test_what_is_packed_is_read_back(spec: NetworkSpec, build: Build, seed: int) -> None:
    rng = np.random.default_rng(seed)
    blob = with_edge_thresholds(WeightBlob.random(spec, rng), rng)
    held = packing.memories(build, blob)
    assert held[2].size == 8 * engine_words(groups(spec.hidden_units), groups(spec.actions))
    found = packing.parameters(build, spec, held)
    for name, expected in blob.parameters().items():
        np.testing.assert_array_equal(found[name], expected)


@settings(max_examples=30)
@given(SPECS, BUILDS, st.integers(0, 2**32 - 1))
def test_any_flipped_bit_is_another_policy_or_none(
    spec: NetworkSpec, build: Build, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    blob = WeightBlob.random(spec, rng)
    held = packing.memories(build, blob)
    part = held[rng.integers(3)].reshape(-1)
    part[rng.integers(part.size)] ^= np.uint32(1 << rng.integers(32))
    try:
        found = packing.parameters(build, spec, held)
    except (BlobError, ValueError):
        return
    assert any(not np.array_equal(found[name], value) for name, value in blob.parameters().items())


@pytest.mark.parametrize("pixel_bytes", [1, 2, 4, 8, 16])
def test_pixels_go_in_raster_order(pixel_bytes: int) -> None:
    build = Build(pixel_bytes=pixel_bytes)
    image = np.arange(4 * 84 * 84, dtype=np.uint32).astype(np.uint8).reshape(4, 84, 84)
    np.testing.assert_array_equal(
        packing.beats(build, image).reshape(84, 84, 4), image.transpose(1, 2, 0)
    )
