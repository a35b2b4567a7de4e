"""From the network's integers to an action: softmax (the paper's Eq. 9) or epsilon-greedy (DQN).

Plain floats on purpose: for |A| <= 64 numbers numpy's calls cost more than the arithmetic, and this is
on the way from camera to action.
"""

from math import exp

import numpy as np
import numpy.typing as npt

Outputs = npt.NDArray[np.int32]


def softmax_probabilities(outputs: Outputs, scale: float, beta: float) -> list[float]:
    """pi(a|s) = exp(beta P(s,a)) / sum_b exp(beta P(s,b)) with P = lambda * o (Eq. 9, 14).

    Args:
        outputs: o, int32[|A|].
        scale: lambda.
        beta: inverse temperature.

    Returns:
        |A| numbers that sum to 1.
    """
    o = outputs.tolist()
    top = max(o)
    weights = [exp(beta * scale * (value - top)) for value in o]
    total = sum(weights)
    return [weight / total for weight in weights]


def softmax_action(outputs: Outputs, scale: float, beta: float, uniform: float) -> int:
    """The action that the softmax policy draws for a uniform number in [0, 1) (inverse CDF)."""
    cumulative = 0.0
    for action, probability in enumerate(softmax_probabilities(outputs, scale, beta)):
        cumulative += probability
        if uniform < cumulative:
            return action
    return len(outputs) - 1  # the sum rounded to just below 1, and the number lies above it


def epsilon_greedy_action(outputs: Outputs, epsilon: float, uniform: float) -> int:
    """With probability epsilon any action, else the first of the best, from one uniform number."""
    if uniform < epsilon:
        return min(int(uniform / epsilon * len(outputs)), len(outputs) - 1)
    return int(np.argmax(outputs))
