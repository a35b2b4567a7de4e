"""A trained policy: from an observation to preferences and an action."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from bpn_edge.factored import joint_selector
from bpn_edge.kernel import load
from bpn_edge.kernel.choice import choose_kernel, kernels_here
from bpn_edge.policy import epsilon_greedy_action, softmax_action, softmax_weights
from bpn_shared.bnn.weights import Weights
from bpn_shared.errors import InputError
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import stack
from bpn_shared.spec.tasks import TaskSpec

Observation = npt.NDArray[np.uint8]


class Policy:
    """One weights version of a run, on the kernel that an edge runs it on.

    Args:
        config: of the run.
        weights: of the run.
        kernel: an installed one, such as "golden"; None: as an edge here would choose for the run.

    Raises:
        InputError: the kernel is not installed, or does not run such a policy.

    Attributes:
        task: what the policy is for: shapes, names of actions, control period.
        weights: signs and thresholds, or an ONNX model.
    """

    def __init__(self, config: RunConfig, weights: Weights, *, kernel: str | None = None) -> None:
        self.task: TaskSpec = config.task_spec
        self.weights = weights
        self._beta = config.beta_of(weights.version)
        network = config.algorithm_spec.network
        self._kernel = load(kernel or choose_kernel(config.kernel, network, kernels_here()))
        self._kernel.load(weights)

    def _outputs(self, observation: Observation) -> npt.NDArray[np.int32 | np.float32]:
        _check("the observation", observation, self.observation_shape)
        return self._kernel.run(observation)

    @property
    def _dims(self) -> tuple[int, ...]:
        return self.weights.spec.action_dims

    @property
    def version(self) -> int:
        """Policy updates that were done; 0 is the initial policy."""
        return self.weights.version

    @property
    def observation_shape(self) -> tuple[int, int, int]:
        """[C, height, width] of an observation, which is uint8."""
        return self.weights.spec.observation_shape

    def observation(self, frames: Sequence[npt.NDArray[np.uint8]]) -> Observation:
        """The observation after the newest of an episode's frames.

        Args:
            frames: uint8[c, height, width] each, oldest first; at least one. Fewer than the policy looks back at
                are an episode's beginning.

        Returns:
            uint8[C, height, width].

        Raises:
            InputError: there is none, or one has another dtype or shape.
        """
        if not len(frames):
            raise InputError("frames are none: an observation needs at least one")
        for frame in frames:
            _check("a frame", frame, self.task.frame_shape)
        return stack(
            frames,
            len(frames) - 1,
            self.task.frames_stacked,
            difference=self.task.gym.difference,
        )

    def preferences(self, observation: Observation) -> npt.NDArray[np.float64]:
        """P(s, a) of every action, float64[|A|].

        Raises:
            InputError: the observation has another dtype or shape.
        """
        outputs = self._outputs(observation).astype(np.float64)
        outputs *= self.weights.scale
        return outputs

    def probabilities(self, observation: Observation) -> npt.NDArray[np.float64]:
        """The softmax policy's pi(a | s) (the paper's Eq. 9), float64[|A|].

        Of an action of several dimensions it is each dimension's own, side by side.

        Raises:
            InputError: the observation has another dtype or shape.
        """
        outputs = self._outputs(observation)
        found, first = [], 0
        for choices in self._dims:
            own = outputs[first : first + choices]
            weights = np.array(softmax_weights(own, self.weights.scale, self._beta))
            found.append(weights / weights.sum())
            first += choices
        return np.concatenate(found)

    def act(self, observation: Observation, *, rng: np.random.Generator | None = None) -> int:
        """The best action, or with a generator one drawn from the softmax policy.

        Args:
            observation: uint8[C, height, width].
            rng: where to draw from, as training does.

        Returns:
            The action's number; `task.action_name` says what it does, and `task.choices` what is chosen in each
            dimension, where there are several.

        Raises:
            InputError: the observation has another dtype or shape.
        """
        outputs, dims = self._outputs(observation), self._dims
        if rng is None:
            best = joint_selector(lambda own, _: epsilon_greedy_action(own, 0.0, 0.0), dims)
            return best(outputs, [0.0] * len(dims))
        scale, beta = self.weights.scale, self._beta
        drawn = joint_selector(lambda own, u: softmax_action(own, scale, beta, u), dims)
        return drawn(outputs, rng.random(len(dims)).tolist())


def _check(what: str, given: object, shape: tuple[int, ...]) -> None:
    if not isinstance(given, np.ndarray):
        raise InputError(f"{what} is a {type(given).__name__}, not a numpy array uint8{[*shape]}")
    if given.dtype != np.uint8 or given.shape != shape:
        raise InputError(f"{what} is {given.dtype}{[*given.shape]}, not uint8{[*shape]}")
