"""What a run begins with that takes another one's weights over: its copy of that run's checkpoint.

The configuration has the SHA-256 of the other run's policy: its signs, thresholds and lambda, or its model, are
known whatever became of that run. The latent weights behind the signs are known from the copy alone.
"""

import json
import struct

import torch
from safetensors import SafetensorError
from safetensors.torch import load
from torch import Tensor

from bpn.verify.findings import Findings
from bpn.verify.play import Policy
from bpn.verify.trainee import NORM_EPSILON, Trainee, frozen, smallest_on
from bpn.verify.weights import described, digest, same_bits
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.weights import Weights
from bpn_shared.runs.digests import arrays_digest
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.warm_start import FILE
from bpn_shared.spec.config import ConfigError

_CHECK = "initial weights"
_DAMAGED = (SafetensorError, KeyError, ValueError, RuntimeError, struct.error)


def check_taken_over(
    folder: RunFolder, trainees: list[Trainee], released: Policy, findings: Findings
) -> bool:
    """Compares version 0 with what was taken over, and gives the trainees the same beginning.

    Args:
        released: version 0 of the run.

    Returns:
        Whether they begin with what the learner began with.
    """
    run, version, sha256 = folder.config().init_from.split(":")
    name = f"version {version} of run {run}"
    findings.compare(
        _CHECK, f"SHA-256 of version 0, which is {name}", digest(folder.weights(0)), sha256
    )
    _check_source(folder, run, int(version), sha256, findings)
    try:
        data = folder.read_file(FILE)
        tensors = load(data)
        _check_digest(data, tensors, findings)
        for trainee in trainees:
            policy = _take_over(trainee, tensors)
    except OSError as error:
        return findings.compare(_CHECK, FILE, str(error.strerror), f"the checkpoint of {name}")
    except _DAMAGED as error:
        reason = " ".join(str(error).split())[:200]
        return findings.compare(_CHECK, FILE, reason, f"the checkpoint of {name}")
    if same_bits(policy, released):
        return findings.compare(_CHECK, "version 0", True, True)
    return findings.compare(_CHECK, "version 0", *described(released, policy))


def _check_source(
    folder: RunFolder, run: str, version: int, sha256: str, findings: Findings
) -> None:
    """Against the other run itself, where that is here."""
    try:
        source: Weights = RunFolder.open(folder.path.parent, run).weights(version)
    except (ConfigError, OSError, BlobError) as error:
        findings[_CHECK].note(
            f"run {run} cannot be asked: {error}; its policy is known by its SHA-256"
        )
        return
    findings.compare(_CHECK, f"SHA-256 in the folder of run {run}", digest(source), sha256)


def _check_digest(data: bytes, tensors: dict[str, Tensor], findings: Findings) -> None:
    (length,) = struct.unpack_from("<Q", data)
    said = json.loads(data[8 : 8 + length]).get("__metadata__")
    if said is None:
        findings[_CHECK].note(f"{FILE} is of schema 1 and has no digest")
        return
    found = arrays_digest(
        (name, str(value.dtype), value.shape, value.contiguous().numpy().tobytes())
        for name, value in tensors.items()
    )
    findings.compare(_CHECK, f"SHA-256 of {FILE}", found, said.get("sha256"))


@torch.no_grad()
def _take_over(trainee: Trainee, tensors: dict[str, Tensor]) -> Policy:
    """Sets a trainee's parameters; Adam's moments stay those of a beginning. Returns its policy."""

    def of(name: str, like: Tensor | None = None) -> Tensor:
        tensor = tensors[f"network.{name}"]
        if like is not None and tensor.shape != like.shape:
            raise ValueError(f"{name} is {list(tensor.shape)}, the network's is {list(like.shape)}")
        return tensor

    if not trainee.binary:
        trainee.weights.copy_(of("weights", trainee.weights))
        trainee.biases.copy_(of("biases", trainee.biases))
        return frozen(trainee)
    trainee.weights.copy_(of("latent", trainee.weights))
    trainee.gamma.copy_(of("gamma", trainee.gamma))
    trainee.beta.copy_(of("beta", trainee.beta))
    trainee.log_scale.copy_(of("log_scale", trainee.log_scale))
    rows, thresholds, channels = [w.clone() for w in trainee.rows()], [], trainee.channels[:-1]
    parts = (trainee.gamma, trainee.beta, of("mean"), of("var"))
    for layer, (gamma, beta, mean, var) in enumerate(
        zip(*(torch.split(part, channels) for part in parts), strict=True)
    ):
        a = gamma.double() / torch.sqrt(var + NORM_EPSILON)
        b = beta.double() - a * mean
        rows[layer][a < 0] *= -1
        thresholds.append(smallest_on(a.abs(), b, trainee.spec.layers[layer].max_output))
    return Policy(tuple(rows), tuple(thresholds), (), trainee.scale, *trainee.shape)
