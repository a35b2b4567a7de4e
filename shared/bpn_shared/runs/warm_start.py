"""What a run takes from another one to begin with: its newest weights, as they are in its checkpoint.

Every version of a binarized policy is in `weights/`, but only the checkpoint has the latent weights behind its
bits, from which learning goes on. They are copied when the run is made, so that it needs the other one no more.
The configuration says whose they are: RUN:VERSION:SHA256, the SHA-256 being that of the policy (`content_sha256`).
"""

import json
import struct
from typing import TYPE_CHECKING

from bpn_shared.bnn.envelope import BlobError
from bpn_shared.spec.config import ConfigError, RunConfig

if TYPE_CHECKING:
    from bpn_shared.runs.folder import RunFolder

FILE = "initial.safetensors"
"""In the run folder: the other run's checkpoint."""


def taken_over(config: RunConfig, source: "RunFolder") -> tuple[RunConfig, bytes]:
    """The configuration with the full name of what it begins with, and the other run's checkpoint.

    Raises:
        ConfigError: the other run's network has another shape, or it has no such weights to go on from.
    """
    _, wanted, sha256 = (*config.init_from.split(":"), "", "")[:3]
    said = f"init_from = {config.init_from!r}"
    _check_shape(said, config, source.config())
    try:
        data = source.read_file(source.checkpoint_path.name)
        version = _version(data)
        weights = source.weights(version)
    except FileNotFoundError as error:
        raise ConfigError(
            f"{said}: run {source.run} has no checkpoint yet, it is written after the first iteration"
        ) from error
    except (OSError, ValueError, BlobError) as error:
        raise ConfigError(f"{said}: of run {source.run} cannot be begun with: {error}") from error
    if wanted and int(wanted) != version:
        raise ConfigError(
            f"{said}: only version {version} of that run can be gone on from, the newest: of the others it keeps "
            "the policy, and not the latent weights and statistics behind it"
        )
    found = weights.content_sha256()
    if sha256 and sha256 != found:
        raise ConfigError(f"{said}: version {version} of that run has the SHA-256 {found}")
    return config.model_copy(update={"init_from": f"{source.run}:{version}:{found}"}), data


def _check_shape(said: str, config: RunConfig, other: RunConfig) -> None:
    kinds = config.algorithm_spec.network, other.algorithm_spec.network
    if kinds[0] != kinds[1]:
        raise ConfigError(
            f"{said}: its algorithm {other.algorithm!r} has a {kinds[1]} network, "
            f"{config.algorithm!r} a {kinds[0]} one"
        )
    if config.network != other.network:
        raise ConfigError(f"{said}: its network is {_shape(other)}, this run's is {_shape(config)}")


def _shape(config: RunConfig) -> str:
    network = config.network
    said = f"{network.channels} channels x {network.hidden_units} hidden units x {network.actions} actions"
    if not network.is_paper_shape:
        said += f", convolutions {config.conv}, {network.image_px} px"
    return said


def _version(checkpoint: bytes) -> int:
    """The updates done, of a safetensors file's array `iteration`."""
    try:
        (length,) = struct.unpack_from("<Q", checkpoint)
        header = json.loads(checkpoint[8 : 8 + length])
        begin, end = header["iteration"]["data_offsets"]
        (version,) = struct.unpack("<q", checkpoint[8 + length + begin : 8 + length + end])
    except (struct.error, KeyError, TypeError, ValueError) as error:
        raise ValueError("checkpoint.safetensors is damaged") from error
    return int(version)
