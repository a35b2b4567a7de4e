"""Everything that reads bytes from elsewhere: with inputs that are right, and with how it refuses others."""

import hashlib
import json
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson
import torch
from older_blobs import dense
from paper import TASKS
from pydantic import ValidationError

from bpn_dashboard.hub.protocol import ProtocolError, parse_client_message
from bpn_dashboard.registry.about import About, SweepFile
from bpn_dashboard.registry.progress import Record
from bpn_dashboard.series.lines import parse_lines
from bpn_edge.kernel.native import NativeKernel
from bpn_edge.kernel.onnx_admission import admit
from bpn_learner.networks import make_network
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.weights import decode_weights
from bpn_shared.bus.logs import as_said_by
from bpn_shared.messages import log_lines
from bpn_shared.messages.action import Action
from bpn_shared.messages.base import Message, MessageError
from bpn_shared.messages.control import (
    Assignment,
    EpisodeReceipt,
    Fault,
    FaultReceipt,
    NextEpisode,
    Reset,
    ResetReply,
)
from bpn_shared.messages.decision import Decision
from bpn_shared.messages.episode import Episode, EpisodeMeta, decode_meta
from bpn_shared.messages.frame import FrameHeader, FrameKind, decode_frame
from bpn_shared.messages.lease import GiveBack, LeaseReply, LeaseRequest, Release, ReleaseReply
from bpn_shared.messages.metrics import MetricsBatch, Point
from bpn_shared.messages.preview import PreviewHeader
from bpn_shared.messages.probe import ProbeReply, ProbeRequest
from bpn_shared.messages.rendezvous import RendezvousReply, RendezvousRequest
from bpn_shared.messages.telemetry import (
    CertificateLife,
    KeyTraffic,
    Percentiles,
    Telemetry,
    WeightsMark,
)
from bpn_shared.runs.config_file import decode_config, encode_config
from bpn_shared.runs.digests import DamagedError, seal, seal_line
from bpn_shared.runs.lines import read_line
from bpn_shared.runs.state import RunState, decode_state, encode_state
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.network import Convolution, NetworkSpec

RUN = "0198c0de-0000-7000-8000-000000000001"
TASK = TASKS["reaching"]
SPEC = NetworkSpec(1, 8, 4)
OTHER_SPEC = NetworkSpec(
    2, 9, 6, convolutions=(Convolution(5, 3, 11),), image_px=12, action_dims=(2, 4)
)


@dataclass(frozen=True)
class Decoder:
    """Something that reads bytes.

    Attributes:
        seeds: inputs that are right.
        refusals: the errors that it may raise, and no others.
        mend: makes the checksum of a changed input right again, so that what lies behind it is reached.
    """

    name: str
    decode: Callable[[bytes], object]
    seeds: Sequence[bytes]
    refusals: tuple[type[Exception], ...]
    mend: Callable[[bytes], bytes] = bytes


MESSAGES: list[Message] = [
    Reset(iteration=1, episode=2, seed=3, reset_id=4),
    ResetReply(reset_id=2**64 - 1),
    NextEpisode(slot=0, worker="edge-1a", weights_version=7),
    Assignment(status="play", iteration=1, episode=2, seed=3, weights_version=1),
    EpisodeReceipt(status="refused", reason="no"),
    Fault(iteration=1, episode=2, worker="edge-1a", reason="the camera is dark"),
    FaultReceipt(),
    LeaseRequest(
        role="edge", worker="edge-1a", label="host/3", version="1.2", protocol=1,
        gave_back=GiveBack(run=RUN, slot=1, reason="no"), plugins={"bpn.kernels": ("native", "own")},
    ),
    LeaseReply(status="lease", run=RUN, slot=3, retry_s=1.0),
    Release(run=RUN, reason="stopped"),
    ReleaseReply(working=True),
    RendezvousRequest(rank=1, worker="learner-1a"),
    RendezvousReply(status="meet", host="10.0.0.1", port=12345),
    MetricsBatch(points=[Point(name="loss", step=1, value=0.5, time_ns=1)]),
    ProbeRequest(
        task="gym:CartPole-v1", frame_channels=3, steps=10, env_kwargs='{"a": [1]}', env_wrappers="a.b:C,D",
        observation_key="k", crop="0,1,2,3", frames_from="observations", difference=True,
    ),
    ProbeReply(actions=2, seen="renders", note="n"),
    Decision(
        iteration=1, episode=2, step=3, action=4, outputs=[-5, 2**31 - 1], scale=0.25,
        weights_version=1, inference_ns=5000, edge_ns=90_000, time_ns=2**63,
    ),
    Telemetry(
        kind="edge", worker="edge-1", run=RUN, slot=3, host="cell", clock="boot", pid=7, time_ns=1,
        uptime_s=0.5, waiting_for="a frame", waiting_s=0.25, cpu_percent=3.5, rss_bytes=2**30,
        counters={"frames_refused": 1}, weights={"loaded": WeightsMark(attempt=1, version=2, time_ns=3)},
        latencies={"edge_us": Percentiles(count=1, p50_us=-1.5, p95_us=2.0, p99_us=2.0, max_us=9.0)},
        traffic=[KeyTraffic(key="a/b", direction="sent", messages=1, bytes=2, dropped=0)],
        refusals={"frames_refused": "too large"}, certificate=CertificateLife(start_unix_s=1.0, end_unix_s=2.5),
    ),
]  # fmt: skip
META = EpisodeMeta(
    iteration=0, episode=0, seed=1, slot=0, worker="edge-0", weights_attempt=1, weights_version=0,
    terminated=False, deadline_misses=0, duration_ns=1,
)  # fmt: skip
INSIDE = {CertificateLife, EpisodeMeta, GiveBack, Point, KeyTraffic, Percentiles, WeightsMark}
"""Messages that travel within others."""


def _episode(outputs: type) -> bytes:
    rng = np.random.default_rng(0)
    return Episode(
        meta=META,
        frames=rng.integers(0, 4, (3, *TASK.frame_shape), dtype=np.uint8),
        actions=np.array([1, 2], np.uint8),
        rewards=np.array([np.nan, -1.0]),
        outputs=np.zeros((2, TASK.actions), outputs),
        inference_ns=np.zeros(2, np.uint32),
        camera_to_action_ns=np.zeros(2, np.uint32),
    ).encode()


def _float_policy() -> FloatWeights:
    generator = torch.Generator().manual_seed(0)
    weights = make_network("float", SPEC, scale_initial=1.0, generator=generator).export()
    assert isinstance(weights, FloatWeights)
    return weights


def _with_sha256(data: bytes) -> bytes:
    """Weights of either kind end with the digest of all before it."""
    return data[:-32] + hashlib.sha256(data[:-32]).digest()


def _run_weights(data: bytes) -> None:
    weights = decode_weights(data)
    if isinstance(weights, WeightBlob):
        kernel = NativeKernel()
        kernel.load(weights)
        kernel.run(weights.spec.probe())
    else:
        admit(weights.model, weights.spec)


def _resealed(seal: Callable[[dict[str, Any]], bytes]) -> Callable[[bytes], bytes]:
    """Makes the digest of a JSON document or line right, where it still is JSON."""

    def mend(data: bytes) -> bytes:
        try:
            values = json.loads(data)
            values.pop("sha256", None)
            return seal(values)
        except (ValueError, RecursionError, AttributeError):  # no JSON, or no object
            return data

    return mend


def _log_line(data: bytes) -> None:
    log_lines.parse(data.decode("utf-8", "replace"))
    for line in as_said_by("edge-0", data).decode().split("\n"):
        assert log_lines.parse(line).service in (None, "edge-0")


def decoders() -> list[Decoder]:
    """All of them; what they need is made when this is called."""
    policy = _float_policy()
    blobs = [
        *(
            WeightBlob.random(spec, np.random.default_rng(0)).encode()
            for spec in (SPEC, OTHER_SPEC)
        ),
        dense(WeightBlob.random(SPEC, np.random.default_rng(0))),
    ]
    frame = FrameHeader(FrameKind.MID, 1, 2, 3, 4, 5).encode()
    pixels = bytes(int(np.prod(TASK.frame_shape)))
    config = RunConfig.for_task("reaching")
    record: dict[str, Any] = {
        "iteration": 3, "attempt": 1, "weights_version": 3, "length": 20.0, "return_px": -1.5,
        "returns_px": [-1.0, -2.0], "loss": None, "nested": {"a": 1, "b": [1]}, "text": "x",
    }  # fmt: skip
    live = [
        '{"op":"hello","proto":1}', f'{{"op":"sub","id":1,"topic":"camera/{RUN}/0","rate_hz":5}}',
        '{"op":"ack","id":1,"seq":3}', '{"op":"ping","t":1.5}', '{"op":"unsub","id":1}',
    ]  # fmt: skip
    sweep = {
        "id": RUN,
        "name": "s",
        "config": {},
        "grid": {"alpha": [1]},
        "seeds": [1],
        "created_at": 1,
    }
    said = b"2026-11-22T08:22:35.123Z edge-0 WARNING text\nTraceback:\n  File x"
    return [
        *(
            Decoder(type(message).__name__, type(message).decode, [message.encode()], (MessageError,))
            for message in MESSAGES
        ),
        Decoder("frame header", FrameHeader.decode, [frame], (MessageError,)),
        Decoder("frame", lambda d: decode_frame(d[:80], d[80:] or pixels, TASK.frame_shape), [frame],
                (MessageError,)),
        Decoder("action", lambda d: Action.decode(d, 14), [Action(1, 2, 3, 4, 5, 6).encode()],
                (MessageError,)),
        Decoder("preview", PreviewHeader.decode, [PreviewHeader(6, 2, 3, 4, 5, 6).encode()],
                (MessageError,)),
        Decoder("episode", lambda d: Episode.decode(d, TASK), [_episode(np.int32), _episode(np.float32)],
                (MessageError,)),
        Decoder("episode's head", decode_meta, [_episode(np.int32)], (MessageError,)),
        Decoder("weights", _run_weights, [*blobs, policy.encode()], (BlobError,), _with_sha256),
        Decoder("ONNX", lambda d: admit(d, SPEC), [policy.model], (BlobError,)),
        Decoder("config.json", lambda d: decode_config(d, source="x"), [encode_config(config)],
                (ConfigError,), _resealed(seal)),
        Decoder("state.json", lambda d: decode_state(d, source="x"),
                [encode_state(RunState(state="running", attempt=2))], (ConfigError,), _resealed(seal)),
        Decoder("about.json", About.decode, [seal(About(name="n").model_dump())],
                (DamagedError, ValidationError), _resealed(seal)),
        Decoder("sweep", SweepFile.decode, [seal(sweep), orjson.dumps(sweep)],
                (DamagedError, ValidationError), _resealed(seal)),
        Decoder("line of a run", lambda d: read_line(d, sealed=False), [seal_line(record)],
                (DamagedError, ValueError), _resealed(seal_line)),
        Decoder("progress", Record.model_validate_json, [seal_line(record)], (ValidationError,)),
        Decoder("series", parse_lines, [seal_line(record) + b"\n" + orjson.dumps(record) + b"\n"], ()),
        Decoder("live view", lambda d: parse_client_message(d.decode("utf-8", "replace")),
                [line.encode() for line in live], (ProtocolError,)),
        Decoder("log line", _log_line, [said], ()),
    ]  # fmt: skip


_WORDS = (
    b"", b"\x00", b"\xff" * 4, b"\x7f\xff\xff\xff", b"\x80\x00\x00\x00", b"\xff" * 8, b"NaN", b"1e999", b"-1",
    b"9" * 40, b"[" * 300, b'{"a":' * 300, b"\x91" * 300, b"\x81\xa1a" * 200, b"\xdf\xff\xff\xff\xff",
    b"\xc6\xff\xff\xff\xff", b"\xc7\xff\x01", b"\\u0000", b"\\ud800", b"\n", b'"', b"null", b"true",
    b"\xed\xa0\x80",
)  # fmt: skip


def mutated(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """A right input, changed in one to four ways."""
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.randint(1, 4)):
        begin = rng.randrange(len(data) + 1)
        end = min(len(data), begin + rng.choice((0, 1, 2, 4, 8, 64)))
        match rng.randrange(7):
            case 0 if begin < len(data):
                data[begin] ^= 1 << rng.randrange(8)
            case 1 if begin < len(data):
                data[begin] = rng.randrange(256)
            case 2:
                data[begin:end] = rng.choice(_WORDS)
            case 3:
                data[begin:begin] = rng.choice(_WORDS)
            case 4:
                del data[begin:end]
            case 5:
                data[begin:begin] = data[begin:end] * rng.choice((1, 2, 50))
            case _:
                other = rng.choice(seeds)
                data[begin:] = other[rng.randrange(len(other) + 1) :]
    return bytes(data)
