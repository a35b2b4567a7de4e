from collections.abc import Callable
from typing import Any

import numpy as np

from bpn_robot_sim.reaching.optimum import optimal_return, random_return


def test_reaching_gets_far_better_than_random_within_twelve_iterations(
    train: Callable[..., dict[str, Any]],
) -> None:
    run = train("reaching", "--seed", "0", "--iterations", "12")
    last = float(np.mean(run["returns"][-5:]))
    # halfway from random play to the optimum, on average over the last five iterations
    assert last > (random_return() + optimal_return()) / 2
    assert max(run["returns"]) <= optimal_return() + 1.0  # nothing beats the optimum
