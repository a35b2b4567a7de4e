"""From the network's integers to an action: softmax (the paper's Eq. 9) or epsilon-greedy (DQN)."""

import numpy as np
import numpy.typing as npt

Outputs = npt.NDArray[np.int32]


def softmax_probabilities(outputs: Outputs, scale: float, beta: float) -> npt.NDArray[np.float64]:
    """pi(a|s) = exp(beta P(s,a)) / sum_b exp(beta P(s,b)) with P = lambda * o (Eq. 9, 14).

    Args:
        outputs: o, int32[|A|].
        scale: lambda.
        beta: inverse temperature.

    Returns:
        float64[|A|], sums to 1.
    """
    logits = beta * scale * outputs.astype(np.float64)
    weights = np.exp(logits - logits.max())
    probabilities: npt.NDArray[np.float64] = weights / weights.sum()
    return probabilities


def softmax_action(outputs: Outputs, scale: float, beta: float, uniform: float) -> int:
    """The action that the softmax policy draws for a uniform number in [0, 1) (inverse CDF)."""
    cumulative = np.cumsum(softmax_probabilities(outputs, scale, beta))
    # the sum may round to just below 1, and the uniform number lie above it
    return min(int(np.searchsorted(cumulative, uniform, side="right")), len(outputs) - 1)


def epsilon_greedy_action(outputs: Outputs, epsilon: float, uniform: float) -> int:
    """With probability epsilon any action, else the first of the best, from one uniform number."""
    if uniform < epsilon:
        return min(int(uniform / epsilon * len(outputs)), len(outputs) - 1)
    return int(np.argmax(outputs))
