"""The project's own algorithms, entry points of bpn-shared: two choices, what computes P and how it is learned.

docs/algorithms says what they are. Their targets are entry points of bpn-learner, their selections of bpn-edge.
"""

from bpn_shared.spec.algorithms import EPSILON_GREEDY, Algorithm, AlgorithmSpec

BPN = Algorithm(AlgorithmSpec(name="bpn", title="BPN: binary network, CVI", targets="cvi"))
BQN = Algorithm(
    AlgorithmSpec(
        name="bqn", title="BQN: binary network, DQN", targets="dqn", selection=EPSILON_GREEDY
    )
)
CVI = Algorithm(
    AlgorithmSpec(name="cvi", title="CVI: float network", network="float", targets="cvi")
)
"""The paper's CVI-Max is the best return of its runs."""
DQN = Algorithm(
    AlgorithmSpec(
        name="dqn",
        title="DQN: float network",
        network="float",
        targets="dqn",
        selection=EPSILON_GREEDY,
    )
)
DPP = Algorithm(
    AlgorithmSpec(
        name="dpp",
        title="DPP: CVI with alpha = 1",
        network="float",
        targets="cvi",
        fixed={"alpha": 1.0},
    )
)
"""Dynamic Policy Programming."""
