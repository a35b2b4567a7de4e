"""From the outputs of a network with several action dimensions to a joint action: each dimension by itself.

The softmax over all joint actions is the product of those over the dimensions, and the best joint action is made
of the best choices (docs/algorithms/factored.md), so neither ever lists the joint actions.
"""

from collections.abc import Callable, Sequence

from bpn_edge.policy import epsilon_greedy_action, softmax_action
from bpn_shared.bnn.outputs import Outputs
from bpn_shared.spec.joint_actions import joined

Choose = Callable[[Outputs, float], int]
"""From one dimension's outputs and a uniform number in [0, 1) to its choice."""


def softmax_joint_action(
    outputs: Outputs, dims: Sequence[int], scale: float, beta: float, uniforms: Sequence[float]
) -> int:
    """The joint action that the softmax policy draws: inverse CDF in each dimension.

    Args:
        outputs: [sum of dims], o or P, the dimensions' side by side.
        scale: lambda, or 1.
        beta: inverse temperature.
        uniforms: a number in [0, 1) for each dimension.
    """
    return _each(outputs, dims, uniforms, lambda own, u: softmax_action(own, scale, beta, u))


def epsilon_greedy_joint_action(
    outputs: Outputs, dims: Sequence[int], epsilon: float, uniforms: Sequence[float]
) -> int:
    """In each dimension, with probability epsilon any choice, else the first of the best."""
    return _each(outputs, dims, uniforms, lambda own, u: epsilon_greedy_action(own, epsilon, u))


def _each(outputs: Outputs, dims: Sequence[int], uniforms: Sequence[float], choose: Choose) -> int:
    choices: list[int] = []
    first = 0
    for choices_there, uniform in zip(dims, uniforms, strict=True):
        choices.append(choose(outputs[first : first + choices_there], uniform))
        first += choices_there
    return joined(choices, dims)
