"""From the network's outputs to an action: softmax (the paper's Eq. 9), epsilon-greedy (DQN), or one's own.

An action selection is an entry point of the group `bpn.selections`: a `Selection`. Where an action has several
dimensions, it chooses in each of them by itself. Plain floats on purpose: for |A| <= 64 numbers numpy's calls cost
more than the arithmetic, and this is on the way from camera to action.
"""

from collections.abc import Callable
from functools import cache
from math import exp

import numpy as np

from bpn_edge.factored import ActionSelector, JointSelector, epsilon_of_each, joint_selector
from bpn_shared import plugins
from bpn_shared.bnn.outputs import Outputs
from bpn_shared.messages.control import Assignment
from bpn_shared.spec.config import RunConfig

Selection = Callable[[RunConfig, Assignment, float], ActionSelector]
"""Of a configuration, an episode that is to be played, and the policy's scale, P = scale * outputs."""


def action_selector(config: RunConfig, assignment: Assignment, scale: float) -> JointSelector:
    """What an episode is to be played with.

    Raises:
        PluginError: the assignment's selection is not installed here, or broken.
    """
    selector: ActionSelector = _selection(assignment.policy).call(config, assignment, scale)
    return joint_selector(selector, config.task_spec.dims)


@cache
def _selection(name: str) -> plugins.Plugin:
    """The installed one: looking it up reads what all distributions say of themselves, several ms an episode."""
    return plugins.find(plugins.SELECTIONS, name)


def softmax(config: RunConfig, assignment: Assignment, scale: float) -> ActionSelector:
    """The `Selection` of CVI."""
    beta = config.beta_of(assignment.weights_version)
    return lambda outputs, uniform: softmax_action(outputs, scale, beta, uniform)


def epsilon_greedy(config: RunConfig, assignment: Assignment, _scale: float) -> ActionSelector:
    """The `Selection` of DQN; of several dimensions, a share epsilon of actions is random in one or more."""
    epsilon = epsilon_of_each(assignment.epsilon, len(config.task_spec.dims))
    return lambda outputs, uniform: epsilon_greedy_action(outputs, epsilon, uniform)


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
