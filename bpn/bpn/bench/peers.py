"""The same network in float32, in the runtimes that the kernel is measured against."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import onnxruntime

from bpn_shared.bnn.onnx_model import INPUT, onnx_model
from bpn_shared.spec.network import MAX_PIXEL, Layer, NetworkSpec

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class FloatNetwork:
    """Weights float32[out, in, kernel, kernel] and biases float32[out] of every layer."""

    spec: NetworkSpec
    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]

    @classmethod
    def random(cls, spec: NetworkSpec, rng: np.random.Generator) -> Self:
        """Weights that keep the activations near 1 for pixels up to 255."""
        weights, biases = [], []
        for layer in spec.layers:
            shape = (layer.out_channels, layer.in_channels, layer.kernel, layer.kernel)
            scale = np.sqrt(2 / layer.fan_in) / layer.max_input
            weights.append((rng.standard_normal(shape) * scale).astype(np.float32))
            biases.append((rng.standard_normal(layer.out_channels) * 0.1).astype(np.float32))
        return cls(spec, tuple(weights), tuple(biases))


def _is_convolution(layer: Layer) -> bool:
    return not layer.is_fully_connected


def _missing(error: ImportError, extra: str) -> RuntimeError:
    return RuntimeError(f"{error.name} is not installed: pip install {extra}")


def onnxruntime_inference(network: FloatNetwork, pixels: Floats) -> Callable[[], Floats]:
    """One inference of `pixels` float32[1, C, 84, 84] in ONNX Runtime with one thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        onnx_model(network.spec, network.weights, network.biases),
        options,
        providers=["CPUExecutionProvider"],
    )
    feed = {INPUT: pixels}

    def infer() -> Floats:
        outputs: Floats = session.run(None, feed)[0]
        return outputs

    return infer


def torch_inference(network: FloatNetwork, pixels: Floats) -> Callable[[], Floats]:
    """One inference of `pixels` float32[1, C, 84, 84] in eager torch with one thread."""
    try:
        import torch  # noqa: PLC0415
    except ImportError as error:
        raise _missing(error, "bpn-learner") from error
    torch.set_num_threads(1)
    functional = torch.nn.functional
    x = torch.from_numpy(pixels)
    parameters = zip(network.spec.layers, network.weights, network.biases, strict=True)
    layers = [(layer, torch.from_numpy(w), torch.from_numpy(b)) for layer, w, b in parameters]

    @torch.inference_mode()
    def infer() -> Floats:
        value = x
        for layer, weights, biases in layers:
            activation = value if value is x else functional.relu(value)
            if _is_convolution(layer):
                value = functional.conv2d(activation, weights, biases, layer.stride)
            else:
                value = functional.linear(activation.flatten(1), weights.flatten(1), biases)
        outputs: Floats = value.numpy()
        return outputs

    return infer


def stable_baselines3_updates(
    spec: NetworkSpec, transitions: int, batch: int, device: str = "cpu"
) -> Callable[[int], None]:
    """Gradient steps of Stable-Baselines3's DQN with the geometry in float, from its full replay buffer.

    Returns:
        A function of the number of gradient steps to take.
    """
    try:
        import gymnasium as gym  # noqa: PLC0415
        import torch  # noqa: PLC0415
        from stable_baselines3 import DQN  # noqa: PLC0415
        from stable_baselines3.common.logger import Logger  # noqa: PLC0415
        from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # noqa: PLC0415
    except ImportError as error:
        raise _missing(error, "'bpn[bench]'") from error

    class Features(BaseFeaturesExtractor):  # type: ignore[misc]
        """Conv(8,4,8), Conv(4,2,16), Conv(3,1,16)."""

        def __init__(self, observation_space: Any) -> None:
            convolutions = [layer for layer in spec.layers if _is_convolution(layer)]
            super().__init__(observation_space, spec.layers[len(convolutions)].fan_in)
            parts: list[torch.nn.Module] = []
            for layer in convolutions:
                parts += [
                    torch.nn.Conv2d(
                        layer.in_channels, layer.out_channels, layer.kernel, layer.stride
                    ),
                    torch.nn.ReLU(),
                ]
            self.parts = torch.nn.Sequential(*parts, torch.nn.Flatten())

        def forward(self, pixels: torch.Tensor) -> torch.Tensor:
            features: torch.Tensor = self.parts(pixels)
            return features

    class Environment(gym.Env[npt.NDArray[np.uint8], np.int64]):
        """Has spaces; is never stepped."""

        observation_space = gym.spaces.Box(0, MAX_PIXEL, spec.observation_shape, np.uint8)
        action_space = gym.spaces.Discrete(spec.actions)

    model = DQN(
        "CnnPolicy",
        Environment(),
        buffer_size=transitions,
        batch_size=batch,
        policy_kwargs={"features_extractor_class": Features, "net_arch": [spec.hidden_units]},
        device=device,
        seed=0,
    )
    model.set_logger(Logger(None, []))
    rng = np.random.default_rng(0)
    for _ in range(transitions):
        now, after = rng.integers(0, MAX_PIXEL + 1, (2, 1, *spec.observation_shape), np.uint8)
        action = rng.integers(spec.actions, size=(1, 1))
        model.replay_buffer.add(now, after, action, rng.normal(size=1), np.zeros(1), [{}])

    def updates(count: int) -> None:
        model.train(count, batch)

    return updates
