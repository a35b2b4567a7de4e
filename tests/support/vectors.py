"""The published vectors, read as their page says."""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.golden import Integers, Observation

VECTORS = Path(__file__).parents[1] / "vectors"
BLOBS = sorted(VECTORS.glob("*.bpnw"))


def answers_of(path: Path) -> Path:
    return path.with_name(path.name.split(".")[0] + ".bin")


def records(blob: WeightBlob, path: Path) -> Iterator[tuple[Observation, list[Integers]]]:
    """Read as the page says."""
    data, at = path.read_bytes(), 4
    for _ in range(struct.unpack_from("<I", data)[0]):
        shape = blob.spec.observation_shape
        image = np.frombuffer(data, np.uint8, int(np.prod(shape)), at).reshape(shape)
        at += image.size
        layers = []
        for layer in blob.spec.layers:
            count = layer.out_size**2 * layer.out_channels
            layers.append(np.frombuffer(data, "<i4", count, at).astype(np.int32))
            at += 4 * count
        yield image, layers
    assert at == len(data)
