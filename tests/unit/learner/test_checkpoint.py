"""The checkpoint: what was saved is what is restored, or an error."""

from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import load, save
from torch import Tensor, nn

from bpn_learner.checkpoint import (
    CheckpointError,
    decode_checkpoint,
    encode_checkpoint,
    state_tensors,
)

GOLDEN = Path(__file__).parents[2] / "golden"
Parts = tuple[nn.Module, torch.optim.Optimizer]


def parts(seed: int = 0, updates: int = 0) -> Parts:
    generator = torch.Generator().manual_seed(seed)
    network = nn.Sequential(nn.Linear(3, 2), nn.BatchNorm1d(2))
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(torch.rand(parameter.shape, generator=generator))
    optimizer = torch.optim.Adam(network.parameters(), lr=0.1)
    for _ in range(updates):
        optimizer.zero_grad()
        network(torch.rand((4, 3), generator=generator)).square().sum().backward()
        optimizer.step()
    return network, optimizer


def equal(one: Parts, other: Parts) -> bool:
    a, b = state_tensors(*one), state_tensors(*other)
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


SAVED = parts(seed=1, updates=3)
DATA = encode_checkpoint(*SAVED, 7)


def test_what_was_saved_is_restored() -> None:
    restored = parts()
    assert not equal(restored, SAVED)
    assert decode_checkpoint(DATA, *restored) == 7
    assert equal(restored, SAVED)
    assert decode_checkpoint(encode_checkpoint(*parts(), 0), *parts()) == 0


@settings(max_examples=300)
@given(position=st.integers(0, len(DATA) - 1), bit=st.integers(0, 7))
def test_a_flipped_bit_is_an_error_or_changes_nothing(position: int, bit: int) -> None:
    data = bytearray(DATA)
    data[position] ^= 1 << bit
    restored = parts()
    try:
        done = decode_checkpoint(bytes(data), *restored)
    except CheckpointError:
        return
    assert (done, equal(restored, SAVED)) == (7, True)


@settings(max_examples=50)
@given(length=st.integers(0, len(DATA) - 1))
def test_a_checkpoint_that_was_cut_is_an_error(length: int) -> None:
    with pytest.raises(CheckpointError, match=r"remove checkpoint\.safetensors to train"):
        decode_checkpoint(DATA[:length], *parts())


def test_every_schema_is_read_for_ever(caplog: pytest.LogCaptureFixture) -> None:
    for schema, warns in ((1, True), (2, False)):
        caplog.clear()
        restored = parts()
        data = (GOLDEN / f"checkpoint-{schema}.safetensors").read_bytes()
        assert decode_checkpoint(data, *restored) == 7
        assert equal(restored, SAVED)
        assert ("no digest" in caplog.text) == warns


def old(**changes: Tensor) -> bytes:
    return save({**load(DATA), **changes})


@pytest.mark.parametrize("iteration", [
    torch.tensor(float("inf")), torch.tensor(float("nan")), torch.tensor(2.0), torch.tensor(-1),
    torch.tensor([1]), torch.tensor(2**62),
])  # fmt: skip
def test_a_number_of_updates_that_is_none_is_an_error(iteration: Tensor) -> None:
    with pytest.raises(CheckpointError, match="iteration"):
        decode_checkpoint(old(iteration=iteration), *parts())


def test_other_versions_and_other_networks_are_errors() -> None:
    tensors = load(DATA)
    for metadata in ({"schema": "3", "sha256": "x"}, {"sha256": "x"}, {"schema": "2"}, {"a": "b"}):
        with pytest.raises(CheckpointError):
            decode_checkpoint(save(tensors, metadata=metadata), *parts())
    other = nn.Linear(9, 9)
    with pytest.raises(CheckpointError, match=r"of another network: .*; remove checkpoint") as said:
        decode_checkpoint(DATA, other, torch.optim.Adam(other.parameters()))
    assert len(str(said.value).splitlines()) == 1
    del tensors["iteration"]
    with pytest.raises(CheckpointError):
        decode_checkpoint(save(tensors), *parts())
