"""From the outputs of a network to an action of one or several dimensions: each dimension is chosen by itself.

The softmax over all joint actions is the product of those over the dimensions, and the best joint action is made
of the best choices (docs/factored-actions.md), so nothing ever lists the joint actions.
"""

from collections.abc import Callable, Sequence
from itertools import accumulate

from bpn_shared.bnn.outputs import Outputs
from bpn_shared.spec.joint_actions import joined

ActionSelector = Callable[[Outputs, float], int]
"""From the outputs of one dimension [n_d] and a uniform number in [0, 1) to a choice 0..n_d-1; a pure function."""
JointSelector = Callable[[Outputs, Sequence[float]], int]
"""From all outputs, the dimensions' side by side, and a uniform number for each to an action's number."""


def joint_selector(choose: ActionSelector, dims: Sequence[int]) -> JointSelector:
    """Chooses in each dimension of n_d choices as a selector of one dimension does."""
    if len(dims) == 1:
        return lambda outputs, uniforms: choose(outputs, uniforms[0])
    ends = list(accumulate(dims))
    slices = [slice(end - n, end) for end, n in zip(ends, dims, strict=True)]

    def select(outputs: Outputs, uniforms: Sequence[float]) -> int:
        pairs = zip(slices, uniforms, strict=True)
        return joined([choose(outputs[part], uniform) for part, uniform in pairs], dims)

    return select


def epsilon_of_each(epsilon: float, dims: int) -> float:
    """The share of random choices in a dimension with which a share epsilon of actions are not all greedy."""
    return epsilon if dims == 1 else 1 - (1 - epsilon) ** (1 / dims)
