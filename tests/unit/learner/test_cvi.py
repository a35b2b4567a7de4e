"""The operators and targets against PFRL's DPP, a Munchausen-DQN formula, and their limits."""

import math

import pfrl
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from pfrl.action_value import DiscreteActionValue
from pfrl.agents.dpp import DPPL
from torch import Tensor, nn

from bpn_learner.cvi import cvi_target, dqn_target, mellowmax

Case = dict[str, Tensor]


@st.composite
def cases(draw: st.DrawFn) -> Case:
    batch = draw(st.integers(1, 8))
    actions = draw(st.integers(2, 64))
    generator = torch.Generator().manual_seed(draw(st.integers(0, 2**32)))
    magnitude = draw(st.floats(1e-3, 1e3))

    def normal(*shape: int) -> Tensor:
        return magnitude * torch.randn(*shape, generator=generator, dtype=torch.float64)

    return {
        "reward": normal(batch),
        "P_s": normal(batch, actions),
        "action": torch.randint(actions, (batch,), generator=generator),
        "P_next": normal(batch, actions),
        "done": torch.rand(batch, generator=generator) < 0.5,
    }


alphas = st.floats(0, 1)
betas = st.floats(1e-2, 1e2)
gammas = st.floats(0, 0.999)


def tolerance(case: Case, beta: float) -> float:
    scale = max(float(value.double().abs().max()) for value in case.values())
    return 1e-9 * max(1.0, scale, 1 / beta)


class Identity(nn.Module):
    """A Q-function whose values are its input; the parameter is there for the optimizer."""

    def __init__(self) -> None:
        super().__init__()
        self.unused = nn.Parameter(torch.zeros(1))

    def forward(self, values: Tensor) -> DiscreteActionValue:
        return DiscreteActionValue(values)


def dppl_target(case: Case, *, beta: float, gamma: float) -> Tensor:
    """The target of PFRL's DPP with the log-sum-exp operator, computed by its own update code."""
    model = Identity()
    agent = DPPL(
        model,
        torch.optim.SGD(model.parameters(), lr=0.0),
        pfrl.replay_buffers.ReplayBuffer(),
        gamma,
        pfrl.explorers.Greedy(),
        eta=beta,
    )
    batch = {
        "state": case["P_s"],
        "action": case["action"],
        "reward": case["reward"],
        "next_state": case["P_next"],
        "is_state_terminal": case["done"].double(),
        "discount": torch.full_like(case["reward"], gamma),
    }
    target: Tensor = agent._compute_y_and_t(batch)[1]
    return target.squeeze(1)


def munchausen_target(case: Case, *, alpha: float, beta: float, gamma: float) -> Tensor:
    """Munchausen-DQN without clipping: q plays P's part, tau = 1 / beta."""
    tau = 1 / beta
    log_pi_s = torch.log_softmax(case["P_s"] / tau, -1).gather(1, case["action"][:, None])[:, 0]
    log_pi_next = torch.log_softmax(case["P_next"] / tau, -1)
    value = (log_pi_next.exp() * (case["P_next"] - tau * log_pi_next)).sum(-1)
    return case["reward"] + alpha * tau * log_pi_s + gamma * (1 - case["done"].double()) * value


@given(cases(), betas, gammas)
def test_with_alpha_1_the_target_is_dppls_up_to_a_constant(
    case: Case, beta: float, gamma: float
) -> None:
    constant = math.log(case["P_s"].shape[1]) / beta
    expected = dppl_target(case, beta=beta, gamma=gamma)
    expected = expected + (1 - gamma * (1 - case["done"].double())) * constant
    y = cvi_target(**case, alpha=1.0, beta=beta, gamma=gamma)
    assert torch.allclose(y, expected, rtol=0, atol=tolerance(case, beta))


@given(cases(), alphas, betas, gammas)
def test_the_target_is_munchausen_dqns_up_to_a_constant(
    case: Case, alpha: float, beta: float, gamma: float
) -> None:
    constant = math.log(case["P_s"].shape[1]) / beta
    expected = munchausen_target(case, alpha=alpha, beta=beta, gamma=gamma)
    expected = expected + (alpha - gamma * (1 - case["done"].double())) * constant
    y = cvi_target(**case, alpha=alpha, beta=beta, gamma=gamma)
    assert torch.allclose(y, expected, rtol=0, atol=tolerance(case, beta))


@given(cases(), alphas, betas, gammas)
def test_without_a_mask_every_transition_bootstraps(
    case: Case, alpha: float, beta: float, gamma: float
) -> None:
    nothing_done = {**case, "done": torch.zeros_like(case["done"])}
    unmasked = {name: value for name, value in case.items() if name != "done"}
    assert torch.equal(
        cvi_target(**nothing_done, alpha=alpha, beta=beta, gamma=gamma),
        cvi_target(**unmasked, alpha=alpha, beta=beta, gamma=gamma),
    )


@given(cases(), gammas)
def test_cvi_without_gap_and_with_infinite_beta_is_dqn(case: Case, gamma: float) -> None:
    y = cvi_target(**case, alpha=0.0, beta=1e12, gamma=gamma)
    expected = dqn_target(case["reward"], case["P_next"], gamma=gamma, done=case["done"])
    assert torch.allclose(y, expected, rtol=0, atol=tolerance(case, 1e12))


def test_the_dqn_target_by_hand() -> None:
    P_next = torch.tensor([[1.0, 3.0], [5.0, -2.0]])
    reward = torch.tensor([-1.0, -2.0])
    assert dqn_target(reward, P_next, gamma=0.5).tolist() == [0.5, 0.5]
    done = torch.tensor([False, True])
    assert dqn_target(reward, P_next, gamma=0.5, done=done).tolist() == [0.5, -2.0]


@given(cases(), betas, st.floats(-1e3, 1e3))
def test_mellowmax_moves_with_its_input_and_lies_between_mean_and_max(
    case: Case, beta: float, shift: float
) -> None:
    P = case["P_s"]
    atol = tolerance(case, beta) + 1e-9 * abs(shift)
    assert torch.allclose(mellowmax(P + shift, beta), mellowmax(P, beta) + shift, rtol=0, atol=atol)
    assert torch.all(mellowmax(P, beta) <= P.amax(-1) + atol)
    assert torch.all(mellowmax(P, beta) >= P.mean(-1) - atol)


@given(cases(), betas, st.integers(0, 63), st.floats(0, 10))
def test_mellowmax_rises_with_every_preference(
    case: Case, beta: float, index: int, rise: float
) -> None:
    raised = case["P_s"].clone()
    raised[:, index % raised.shape[1]] += rise
    slack = tolerance(case, beta)
    assert torch.all(mellowmax(raised, beta) >= mellowmax(case["P_s"], beta) - slack)


@given(cases())
def test_mellowmax_limits(case: Case) -> None:
    P = case["P_s"]
    atol = tolerance(case, 1.0)
    assert torch.allclose(mellowmax(P, 1e12), P.amax(-1), rtol=0, atol=atol)
    assert torch.allclose(mellowmax(P, 1e-15), P.mean(-1), rtol=0, atol=atol)


@settings(max_examples=50)
@given(st.floats(-4, 4), st.booleans(), st.integers(2, 64))
def test_mellowmax_is_stable_in_float32(log_beta: float, negative: bool, actions: int) -> None:
    beta = 10**log_beta
    P = torch.linspace(0, 1e4 / beta, actions) * (-1 if negative else 1)
    exact = torch.logsumexp(beta * P.double(), -1).sub(math.log(actions)) / beta
    assert mellowmax(P, beta).double().item() == pytest.approx(exact.item(), rel=1e-5)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtypes_are_kept(dtype: torch.dtype) -> None:
    P, reward, done = torch.ones(3, 4, dtype=dtype), torch.ones(3, dtype=dtype), torch.ones(3) > 0
    action = torch.zeros(3, dtype=torch.int64)
    y = cvi_target(reward, P, action, P, alpha=0.9, beta=2.0, gamma=0.9, done=done)
    assert (y.dtype, mellowmax(P, 2.0).dtype) == (dtype, dtype)
    assert dqn_target(reward, P, gamma=0.9, done=done).dtype == dtype
