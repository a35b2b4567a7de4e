"""A run's network and optimizer before its first update, as its configuration determines them."""

import math

import torch

from bpn_learner.networks import PNetwork, make_network
from bpn_learner.update import make_optimizer
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.seeds import initial_weights_seed

_FIRST_SPREAD = 0.3
"""Standard deviation of beta P of the first policy: sums of N random signs have sqrt(N)."""


def initial_policy(config: RunConfig) -> tuple[PNetwork, torch.optim.Optimizer]:
    """Network and optimizer of iteration 0, on the run's device.

    Raises:
        ConfigError: the device is not there.
    """
    torch.set_num_threads(1)  # determinism, and other processes share the cores
    network = make_network(
        config.algorithm_spec.network,
        config.network,
        scale_initial=config.scale_initial or nearly_uniform_scale(config),
        generator=torch.Generator().manual_seed(initial_weights_seed(config.seed)),
    ).to(_device(config))
    return network, make_optimizer(network, config.learning_rate)


def nearly_uniform_scale(config: RunConfig) -> float:
    """Lambda with which a policy of random signs is nearly uniform: beta P then varies by `_FIRST_SPREAD`."""
    return _FIRST_SPREAD / (config.beta * math.sqrt(config.hidden_units))


def has_gpu() -> bool:
    """Whether torch finds a GPU on this machine."""
    return torch.cuda.is_available()


def name_of_gpu() -> str:
    """What the GPU is called that torch finds; empty: it finds none."""
    return str(torch.cuda.get_device_name()) if has_gpu() else ""


def _device(config: RunConfig) -> torch.device:
    """The device that the run asks for."""
    if config.device == "cuda" and not has_gpu():
        raise ConfigError("device = 'cuda': torch finds no GPU on this machine; choose cpu")
    torch.backends.cudnn.allow_tf32 = False  # whole float32, or sums of signs are not exact
    return torch.device(config.device)
