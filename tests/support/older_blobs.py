"""Weight blobs of schema 1, which is written no more."""

import hashlib
import struct

import numpy as np

from bpn_shared.bnn.blob import WeightBlob


def dense(blob: WeightBlob) -> bytes:
    """A blob of the paper's shape in schema 1."""
    spec = blob.spec
    assert spec.is_paper_shape
    header = struct.pack(
        "<4sHHHH16sIIf", b"BPNW", 1, spec.channels, spec.hidden_units, spec.actions,
        blob.run.bytes, blob.attempt, blob.version, blob.scale,
    )  # fmt: skip
    bits = b"".join(np.packbits(w > 0, bitorder="little").tobytes() for w in blob.weights)
    taus = b"".join(tau.astype("<i4").tobytes() for tau in blob.thresholds)
    return header + bits + taus + hashlib.sha256(header + bits + taus).digest()
