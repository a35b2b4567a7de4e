"""Binarized networks and observations at the limits of what there may be."""

import numpy as np
from geometries import geometries, shapes

from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.network import NetworkSpec

SPECS = geometries([1, 2, 3, 6, 16], hidden_units=70, actions=20) | shapes()


def awkward_blob(spec: NetworkSpec, rng: np.random.Generator) -> WeightBlob:
    """Random signs; thresholds at int32's ends, the sums' limits and beyond, and some that sums meet."""
    blob = WeightBlob.random(spec, rng)
    sums = golden.forward(blob, awkward_observation(spec, rng))
    ends = np.iinfo(np.int32)
    for layer, tau, o in zip(spec.layers, blob.thresholds, sums, strict=False):
        met = o.reshape(-1, layer.out_channels)
        chosen = rng.integers(0, 8, layer.out_channels)
        special = [ends.min, ends.max, layer.max_output, layer.max_output + 1, -layer.max_output]
        for output in range(layer.out_channels):
            if chosen[output] < len(special):
                tau[output] = special[chosen[output]] if rng.random() < 0.3 else tau[output]
            else:
                tau[output] = rng.choice(met[:, output])
    return blob


def awkward_observation(spec: NetworkSpec, rng: np.random.Generator) -> np.ndarray:
    """uint8: noise, all black, all white, or only the two."""
    shape = spec.observation_shape
    kind = int(rng.integers(0, 4))
    if kind < 2:
        return np.full(shape, 255 * kind, np.uint8)
    noise = rng.integers(0, 256, shape, dtype=np.uint8)
    return noise if kind == 2 else np.where(noise > 127, 255, 0).astype(np.uint8)
