"""From the network's outputs to an action: softmax (the paper's Eq. 9) or epsilon-greedy (DQN).

Plain floats on purpose: for |A| <= 64 numbers numpy's calls cost more than the arithmetic, and this is
on the way from camera to action.
"""

from math import exp

import numpy as np

from bpn_shared.bnn.outputs import Outputs


def softmax_weights(outputs: Outputs, scale: float, beta: float) -> list[float]:
    """pi(a|s) up to its sum: exp(beta (P(s,a) - max_b P(s,b))) with P = scale * outputs (Eq. 9, 14).

    Args:
        outputs: [|A|], o or P.
        scale: lambda, or 1.
        beta: inverse temperature.

    Returns:
        |A| numbers in [0, 1], the best action's is 1.
    """
    o = outputs.tolist()
    top, rate = max(o), beta * scale
    return [exp(rate * (value - top)) for value in o]


def softmax_action(outputs: Outputs, scale: float, beta: float, uniform: float) -> int:
    """The action that the softmax policy draws for a uniform number in [0, 1) (inverse CDF)."""
    weights = softmax_weights(outputs, scale, beta)
    remaining = uniform * sum(weights)
    for action, weight in enumerate(weights):
        remaining -= weight
        if remaining < 0:
            return action
    return len(weights) - 1  # rounding: the number is as good as 1


def epsilon_greedy_action(outputs: Outputs, epsilon: float, uniform: float) -> int:
    """With probability epsilon any action, else the first of the best, from one uniform number."""
    if uniform < epsilon:
        return min(int(uniform / epsilon * len(outputs)), len(outputs) - 1)
    return int(np.argmax(outputs))
