"""D once more with pictures that an update disturbs: the same values, other light."""

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_learner.augmentation import seen_again
from bpn_learner.factory import initial_policy
from bpn_learner.transitions import EpisodeData, data_of
from bpn_learner.update import UpdateConfig, policy_update, preferences
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.disturbances import parse
from bpn_shared.spec.seeds import shuffle_generator

LEVELS = "noise=5..30,offset=-30..30,gain=0.7..1.3,salt_pepper=0.02"


def config(**changes: Any) -> RunConfig:
    return RunConfig.bare("tracking", hidden_units=12, epochs=2, batch_size=8, **changes)


def episodes(seed: int, count: int = 2, steps: int = 6) -> list[EpisodeData]:
    rng = np.random.default_rng(seed)
    return [
        EpisodeData(
            rng.integers(60, 190, (steps + 1, 3, 84, 84), np.uint8),
            rng.integers(0, 7, steps),
            rng.normal(size=steps),
            terminated=False,
        )
        for _ in range(count)
    ]


@given(st.integers(0, 2**63 - 1), st.integers(0, 99))
@settings(max_examples=10, deadline=None)
def test_what_is_drawn_follows_from_run_iteration_and_place(seed: int, iteration: int) -> None:
    D = episodes(0, count=3, steps=2)
    found = seen_again(D, parse(LEVELS), seed, iteration)
    same, later = (seen_again(D, parse(LEVELS), seed, i) for i in (iteration, iteration + 1))
    for one, again, other, clean in zip(found, same, later, D, strict=True):
        assert np.array_equal(one.frames, again.frames)
        assert not np.array_equal(one.frames, other.frames)
        assert not np.array_equal(one.frames, clean.frames)
        assert (one.actions is clean.actions, one.rewards is clean.rewards) == (True, True)
    alone = seen_again(
        D[:1], parse(LEVELS), seed, iteration
    )  # by its place, not by how many there are
    assert np.array_equal(alone[0].frames, found[0].frames)


def test_an_update_fits_both_to_the_targets_of_what_the_robot_saw() -> None:
    """As a D that is twice as long with known targets; gamma and alpha 0 leave y = r."""
    asked = config(gamma=0.0, alpha=0.0, reward_scale=1.0)
    D = episodes(1)
    disturbed = seen_again(D, parse(LEVELS), 0, 0)
    together, two = initial_policy(asked), initial_policy(asked)
    settings_of = UpdateConfig.of_iteration(asked, 0)
    again = data_of(asked, disturbed)
    report = policy_update(
        *together, data_of(asked, D), settings_of, shuffle_generator(0, 0), again=again
    )
    plain = policy_update(
        *two, data_of(asked, [*D, *disturbed]), settings_of, shuffle_generator(0, 0)
    )
    assert report.updates == plain.updates
    assert together[0].export().content_sha256() == two[0].export().content_sha256()


def test_the_folded_network_is_the_evaluated_one_on_all_pictures() -> None:
    asked = config(augment=LEVELS)
    D = episodes(2)
    network, optimizer = initial_policy(asked)
    data, again = data_of(asked, D), data_of(asked, seen_again(D, parse(LEVELS), 0, 0))
    policy_update(
        network, optimizer, data, UpdateConfig.of_iteration(asked, 0), shuffle_generator(0, 0),
        again=again,
    )  # fmt: skip
    weights = network.export()
    assert isinstance(weights, WeightBlob)
    for of in (data, again):
        seen = of.gather(of.observations)
        outputs = np.stack([golden.forward(weights, one.numpy())[-1].ravel() for one in seen])
        P = preferences(network, [seen])
        assert torch.equal(torch.from_numpy(outputs.astype(np.float32)) * weights.scale, P)


@pytest.mark.parametrize(
    ("augment", "said"),
    [
        ("latency=20", "augment = 'latency=20': latency: concerns no pictures; leave it out"),
        ("noise=20,backlash=2", "backlash: concerns no pictures"),
        ("fog=1", "disturbance 'fog' is unknown"),
        ("noise", "disturbance 'noise': must be KIND=LEVEL"),
    ],
)
def test_what_cannot_be_done_to_pictures_is_refused(augment: str, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        config(augment=augment)
    assert said in str(refused.value)


def test_the_text_is_kept_in_one_form() -> None:
    assert config(augment=" offset=-30..30, noise=5.0").augment == "noise=5,offset=-30..30"
