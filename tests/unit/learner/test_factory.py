"""The network that a run begins with: published curves come from its bits."""

import hashlib

import pytest
import torch

from bpn_learner.factory import has_gpu, initial_policy
from bpn_learner.networks import BinaryNetwork, FloatNetwork, PNetwork
from bpn_shared.spec.algorithms import algorithm_names
from bpn_shared.spec.config import ConfigError, RunConfig

PINNED = {
    ("binary", "reaching", 0): "ca9004cb2354ad5d2241c6239038768277c5a8fb9a888ade4d2a7492b544e324",
    ("binary", "tracking", 7): "d6d42945dea233270a1a97cb9009b1d43f655a4ce39e628c632e271e910cf731",
    ("float", "reaching", 0): "8cebd261224621f32659c03dc111e8dcf175f7e383f0b11a1653a5a747c01b9d",
    ("float", "tracking", 7): "e6a6d2bf8796dc75dd3e9523c343dfb661a1bdac7b42c51bd56aaad54aaff371",
}


def sha256(network: PNetwork) -> str:
    digest = hashlib.sha256()
    for parameter in network.parameters():
        digest.update(parameter.detach().numpy().astype("<f4").tobytes())
    return digest.hexdigest()


@pytest.mark.parametrize("algorithm", algorithm_names())
@pytest.mark.parametrize(("task", "seed"), [("reaching", 0), ("tracking", 7)])
def test_initial_weights_are_what_they_always_were(algorithm: str, task: str, seed: int) -> None:
    config = RunConfig.for_task(
        task, algorithm=algorithm, seed=seed, hidden_units=24, scale_initial=0.25
    )
    network, _ = initial_policy(config)
    assert sha256(network) == PINNED[config.algorithm_spec.network, task, seed]


def test_every_seed_has_weights_of_its_own() -> None:
    seeds = [0, 1, 2, 2**63 - 1]
    found = {
        sha256(initial_policy(RunConfig.bare("reaching", seed=seed, hidden_units=8))[0])
        for seed in seeds
    }
    assert len(found) == len(seeds)


@pytest.mark.parametrize("algorithm", ["bpn", "cvi"])
def test_scale_rate_and_threads_are_the_configurations(algorithm: str) -> None:
    config = RunConfig.for_task(
        "reaching", algorithm=algorithm, hidden_units=8, learning_rate=0.03, scale_initial=0.7
    )
    torch.set_num_threads(2)
    network, optimizer = initial_policy(config)
    assert torch.get_num_threads() == 1
    rates = [group["lr"] for group in optimizer.param_groups]
    if isinstance(network, BinaryNetwork):
        assert float(network.scale().detach()) == pytest.approx(0.7)
        assert rates == pytest.approx([0.03, 0.09])
    else:
        assert isinstance(network, FloatNetwork)
        assert rates == [0.03]
    trained = [id(p) for group in optimizer.param_groups for p in group["params"]]
    assert sorted(trained) == sorted(id(p) for p in network.parameters())


def test_a_gpu_is_asked_of_torch_and_missed_at_the_beginning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for there in (False, True):
        monkeypatch.setattr(torch.cuda, "is_available", lambda there=there: there)
        assert has_gpu() is there
        initial_policy(RunConfig.bare("reaching", hidden_units=8))  # which asks for none
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ConfigError, match="torch finds no GPU"):
        initial_policy(RunConfig.bare("reaching", hidden_units=8, device="cuda"))
