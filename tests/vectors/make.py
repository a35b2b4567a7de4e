"""Writes the vectors of this folder again: `python tests/vectors/make.py`; README.md says how to read them.

The same program gives the same bytes, which a test compares.
"""

import hashlib
import struct
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from uuid import UUID

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "support"))

from older_blobs import dense  # noqa: E402 - of the tests

from bpn.testing.kernel import (  # noqa: E402
    make_image,
    with_edge_thresholds,
    with_signs,
    with_ties,
)
from bpn_shared.bnn import golden  # noqa: E402
from bpn_shared.bnn.blob import WeightBlob  # noqa: E402
from bpn_shared.bnn.golden import Observation  # noqa: E402
from bpn_shared.spec.network import NetworkSpec, parse_convolutions  # noqa: E402

RUN = UUID("00112233-4455-6677-8899-aabbccddeeff")
ALL = ("random", "zeros", "full", "black and white")
DIGEST_BYTES = 32


def spec(channels: int, N: int, conv: str, image_px: int, *dims: int) -> NetworkSpec:
    """A network's shape; its actions have that many choices in each dimension."""
    return NetworkSpec(
        channels, N, sum(dims),
        convolutions=parse_convolutions(conv), image_px=image_px, action_dims=dims,
    )  # fmt: skip


PAPER = "8x4x8,4x2x16,3x1x16"
SHAPES = {
    "paper-smallest": (spec(1, 1, PAPER, 84, 2), ("random", "full")),
    "paper-tracking": (spec(6, 100, PAPER, 84, 17), ("random",)),
    "smallest": (spec(1, 1, "1x1x1", 8, 2), ALL),
    "odd-channels": (spec(3, 65, "5x2x7,3x1x33", 20, 3, 2, 4), ALL),
    "left-over-pixels": (spec(2, 40, "4x3x9,2x2x5,1x1x11", 27, 5), ALL),
    "one-position": (spec(4, 9, "16x16x12,1x1x8", 31, 2, 2), ALL),
    "whole-bytes": (spec(2, 64, "3x1x32,4x4x64", 18, 8), ALL),
}
ADVERSARIAL = spec(3, 33, "6x3x9,4x1x17", 24, 6)


def vectors() -> Iterator[tuple[str, WeightBlob, list[Observation]]]:
    """Name, policy and observations of every vector."""
    rng = np.random.default_rng(13)
    for number, (name, (shape, kinds)) in enumerate(SHAPES.items(), 1):
        blob = replace(WeightBlob.random(shape, rng), run=RUN, attempt=2, version=number)
        images = [make_image(kind, shape, rng) for kind in kinds]
        yield name, tied(blob, images[0], rng), images
    images = [make_image(kind, ADVERSARIAL, rng) for kind in ALL]
    yield "thresholds-at-the-ends", with_edge_thresholds(random(rng), rng), images
    for sign in ("all +1", "all -1"):
        blob = with_signs(random(rng), [sign] * len(ADVERSARIAL.layers))
        yield (
            f"signs-{sign.replace(' ', '-').replace('+1', 'plus').replace('-1', 'minus')}",
            blob,
            images,
        )
    blob = before_refused()
    yield "before-refused", blob, [make_image("random", blob.spec, rng)]


def before_refused() -> WeightBlob:
    """What most of the blobs that are to be refused were before."""
    return WeightBlob.random(spec(1, 5, "4x3x9", 10, 5), np.random.default_rng(7))


def tied(blob: WeightBlob, image: Observation, rng: np.random.Generator) -> WeightBlob:
    """With thresholds that are sums of that image, or one beside them: in every layer."""
    for layer in range(len(blob.spec.layers) - 1):
        blob = with_ties(blob, image, layer, rng)
    return blob


def random(rng: np.random.Generator) -> WeightBlob:
    """A policy of the shape that the adversarial ones have."""
    return replace(WeightBlob.random(ADVERSARIAL, rng), run=RUN)


def answers(blob: WeightBlob, images: list[Observation]) -> bytes:
    """Each observation, and every layer's integers."""
    parts = [struct.pack("<I", len(images))]
    for image in images:
        parts.append(image.tobytes())
        parts += [o.astype("<i4").tobytes() for o in golden.forward(blob, image)]
    return b"".join(parts)


def sealed(data: bytes | bytearray) -> bytes:
    """With a digest that is right."""
    return bytes(data) + hashlib.sha256(data).digest()


def refused() -> Iterator[tuple[str, bytes]]:
    """Blobs that no reader may take, each for one reason; but for the first three their digests are right."""
    whole = before_refused().encode()
    yield "altered", bytes([*whole[:200], whole[200] ^ 1, *whole[201:]])
    yield "truncated", whole[:-1]
    yield "oversized", whole + b"\0"
    body = whole[:-DIGEST_BYTES]

    def changed(at: int, value: bytes) -> bytes:
        return sealed(body[:at] + value + body[at + len(value) :])

    yield "magic", changed(0, b"BPNX")
    yield "newer-schema", changed(4, struct.pack("<H", 3))
    yield "no-channels", changed(6, struct.pack("<H", 0))
    yield "kernel-beyond-input", changed(48, struct.pack("<H", 11))
    yield "too-few-layers", changed(10, struct.pack("<H", 2))
    yield "choices-are-not-actions", changed(48 + 3 * 8, struct.pack("<H", 4))
    yield "not-fully-connected", changed(48 + 8, struct.pack("<H", 1))
    yield "reserved-byte", changed(14, b"\1")
    yield "lambda-not-finite", changed(40, struct.pack("<f", np.inf))
    yield "lambda-not-positive", changed(40, struct.pack("<f", 0.0))
    yield "lambda-negative", changed(40, struct.pack("<f", -0.5))
    yield "lambda-not-a-number", changed(40, struct.pack("<f", np.nan))
    yield "older-schema", changed(4, struct.pack("<H", 0))
    yield "too-many-channels", changed(6, struct.pack("<H", 17))
    yield "no-stride", changed(50, struct.pack("<H", 0))
    yield "reserved-behind-lambda", changed(47, b"\1")
    yield "reserved-of-a-layer", changed(48 + 6, b"\1")
    yield "padding-of-the-header", changed(127, b"\1")
    yield "padding-of-a-row", changed(128 + 3, b"\x80")
    yield "padding-behind-signs", changed(128 + 9 * 4, b"\1")
    yield "padding-behind-a-section", changed(len(body) - 1, b"\1")
    yield "a-dimension-without-choice", one_choice()
    older = dense(WeightBlob.random(spec(1, 1, PAPER, 84, 2), np.random.default_rng(7)))
    of_fc2 = 40 + (512 + 2048 + 2304 + 784) // 8
    yield "schema-1-padding", sealed(padded(older[:-DIGEST_BYTES], of_fc2))
    yield "schema-1-truncated", sealed(older[: -DIGEST_BYTES - 1])


def one_choice() -> bytes:
    """Five actions as two dimensions, of which one has a single choice."""
    shape = spec(1, 5, "4x3x9", 10, 2, 3)
    body = bytearray(WeightBlob.random(shape, np.random.default_rng(7)).encode()[:-DIGEST_BYTES])
    struct.pack_into("<HH", body, 48 + 3 * 8, 1, 4)
    return sealed(body)


def padded(body: bytes, at: int) -> bytes:
    """With the highest bit of a byte set."""
    return bytes([*body[:at], body[at] | 0x80, *body[at + 1 :]])


def files() -> Iterator[tuple[str, bytes]]:
    """Every file of the vectors."""
    hashes = ""
    for name, blob, images in vectors():
        hashes += f"{blob.content_sha256()}  {name}\n"
        yield f"{name}.bpnw", blob.encode()
        yield f"{name}.bin", answers(blob, images)
        if name.startswith("paper"):
            yield f"{name}.schema-1.bpnw", dense(blob)
    yield "weights_sha256", hashes.encode()
    for name, data in refused():
        yield f"refused/{name}.bpnw", data


if __name__ == "__main__":
    (HERE / "refused").mkdir(exist_ok=True)
    for name, data in files():
        (HERE / name).write_bytes(data)
