"""What a network's sizes may be, and how its convolutions are written."""

import pytest
from geometries import shapes
from hypothesis import given

from bpn_shared.bus.access import MAX_PIXEL_BYTES, MAX_WEIGHTS_BYTES
from bpn_shared.spec.network import (
    MAX_CHANNELS,
    MAX_IMAGE_SIZE_PX,
    MAX_KERNEL,
    MAX_PIXEL,
    MAX_WEIGHTS,
    PAPER_CONVOLUTIONS,
    Convolution,
    NetworkSpec,
    format_convolutions,
    parse_convolutions,
)


@given(shapes())
def test_convolutions_are_read_as_they_are_written(spec: NetworkSpec) -> None:
    assert parse_convolutions(format_convolutions(spec.convolutions)) == spec.convolutions


def test_the_papers_convolutions() -> None:
    assert format_convolutions(PAPER_CONVOLUTIONS) == "8x4x8,4x2x16,3x1x16"
    assert NetworkSpec(6, 100, 17, parse_convolutions("8x4x8, 4x2x16, 3x1x16")).is_paper_shape


@pytest.mark.parametrize(
    "text", ["", "8", "8x4", "8x4x8x1", "8x4x8,", "-8x4x8", "8x4xb", "8x4x99999", "٨x4x8"]
)
def test_what_is_no_list_of_convolutions_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ValueError, match=r"is no layer: each is KERNELxSTRIDExCHANNELS, such as "):
        parse_convolutions(text)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"image_px": 7}, r"image_px = 7 is outside 8\.\.128"),
        ({"image_px": 129}, r"image_px = 129 is outside 8\.\.128"),
        ({"convolutions": ()}, r"number of layers = 0 is outside 1\.\.6"),
        ({"convolutions": ((1, 1, 1),) * 7}, r"number of layers = 7 is outside 1\.\.6"),
        ({"convolutions": ((17, 1, 1),)}, r"layer 1 \(17x1x1\), kernel = 17 is outside 1\.\.16"),
        ({"convolutions": ((4, 5, 1),)}, r"layer 1 \(4x5x1\), stride = 5 is outside 1\.\.4"),
        ({"convolutions": ((4, 0, 1),)}, r"stride = 0 is outside 1\.\.4"),
        ({"convolutions": ((4, 1, 129),)}, r"channels = 129 is outside 1\.\.128"),
        ({"convolutions": ((8, 8, 1), (12, 1, 1))}, "layer 2 .*kernel is larger than its input, 10 x 10"),
        ({"action_dims": (2, 3)}, r"action_dims = \[2, 3\] have 5 choices together, \|A\| is 4"),
        ({"action_dims": (1, 3)}, r"choices = 1 is outside 2\.\.64"),
        ({"convolutions": ((1, 1, 99),)}, "weights, at most 4,000,000 are allowed"),
        ({"convolutions": ((16, 1, 128), (16, 16, 2)), "channels": 16}, "multiplications, at most 200,000,000"),
    ],
)  # fmt: skip
def test_impossible_sizes_are_named(changes: dict[str, object], reason: str) -> None:
    if "convolutions" in changes:
        changes |= {"convolutions": tuple(Convolution(*c) for c in changes["convolutions"])}  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=reason):
        NetworkSpec(**{"channels": 1, "hidden_units": 100, "actions": 4} | changes)  # type: ignore[arg-type]


def test_one_dimension_of_actions_is_the_default() -> None:
    assert NetworkSpec(1, 8, 4) == NetworkSpec(1, 8, 4, action_dims=(4,))
    assert NetworkSpec(1, 8, 4).action_dims == (4,)
    assert NetworkSpec(1, 8, 4) != NetworkSpec(1, 8, 4, action_dims=(2, 2))


def test_the_largest_networks_travel_and_their_sums_are_exact_in_float32() -> None:
    graph, biases, header = 16 * 1024, 4 * 2048, 512  # of a float policy, at most
    assert 4 * MAX_WEIGHTS + graph + biases + header < MAX_WEIGHTS_BYTES
    assert MAX_CHANNELS * MAX_IMAGE_SIZE_PX**2 <= MAX_PIXEL_BYTES
    assert MAX_KERNEL**2 * MAX_CHANNELS * MAX_PIXEL < 2**24
