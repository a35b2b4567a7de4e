import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bpn_learner.replay import ReplayMemory
from bpn_learner.transitions import EpisodeData


def data_set(sizes: list[int], number: int) -> list[EpisodeData]:
    return [
        EpisodeData(np.zeros((1, 1, 1, 1), np.uint8), np.full(size, number), np.zeros(size), False)
        for size in sizes
    ]


sets = st.lists(st.lists(st.integers(1, 9), min_size=1, max_size=3), min_size=1, max_size=8)


@given(sets, st.integers(1, 5))
def test_the_newest_iterations_are_held(sizes: list[list[int]], iterations: int) -> None:
    memory = ReplayMemory(iterations)
    for number, of_set in enumerate(sizes):
        memory.add(data_set(of_set, number))
    held = sizes[-iterations:]
    assert [len(e.actions) for e in memory.episodes] == [size for of in held for size in of]
    assert {int(e.actions[0]) for e in memory.newest} == {len(sizes) - 1}


@given(sets, st.integers(1, 40))
def test_as_many_whole_iterations_as_fit_and_the_newest_always(
    sizes: list[list[int]], transitions: int
) -> None:
    memory = ReplayMemory(1, transitions)
    for number, of_set in enumerate(sizes):
        memory.add(data_set(of_set, number))
    totals = [sum(of_set) for of_set in sizes]
    count = len({int(e.actions[0]) for e in memory.episodes})
    held = sum(totals[-count:])
    assert held == sum(len(e.actions) for e in memory.episodes)
    assert held <= transitions or count == 1
    assert count == len(totals) or held + totals[-count - 1] > transitions
    # what a training that goes on loads is what one that went through holds
    assert memory.kept(totals) == count
