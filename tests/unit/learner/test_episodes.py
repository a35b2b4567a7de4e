"""The episodes that a run folder has already."""

import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logged import lines
from played import CONFIG, owned, played

from bpn_learner.episodes import DataError, load_episodes
from bpn_shared.runs.ownership import Ownership


@pytest.fixture
def owner(tmp_path: Path) -> Iterator[Ownership]:
    with owned(tmp_path) as owner:
        for index in range(CONFIG.episodes):
            owner.write_episode(1, index, played(1, index))
        yield owner


def names(owner: Ownership) -> list[str]:
    return sorted(path.name for path in (owner.folder.path / "episodes").iterdir())


def test_all_that_are_there_are_found_with_their_rewards(owner: Ownership) -> None:
    found = load_episodes(owner, CONFIG, 1)
    assert sorted(found) == [0, 1, 2, 3]
    for index, scored in found.items():
        assert (scored.episode.meta.episode, scored.kept, len(scored.rewards)) == (index, True, 2)
        assert (scored.rewards < 0).all()
    assert load_episodes(owner, CONFIG, 2) == {}


@settings(max_examples=40)
@given(position=st.integers(0), bit=st.integers(0, 7))
def test_a_flipped_bit_sets_an_episode_aside(
    tmp_path_factory: pytest.TempPathFactory, position: int, bit: int
) -> None:
    with owned(tmp_path_factory.mktemp("runs")) as owner:
        data = bytearray(played(0, 0))
        data[position % len(data)] ^= 1 << bit
        owner.write_episode(0, 0, bytes(data))
        try:
            found = load_episodes(owner, CONFIG, 0)
        except DataError:  # the bit was of the schema's number
            assert names(owner) == ["000000-00000.bpne"]
            return
        assert (found, names(owner)) == ({}, ["000000-00000.damaged-1"])


@pytest.mark.parametrize("data", [
    b"", played(1, 2)[:-3], played(1, 1), played(0, 2), played(1, 2, black=True),
    played(1, 2, seed=4), played(1, 2, steps=1), played(1, 2, weights_version=0),
])  # fmt: skip
def test_what_is_not_this_episode_is_set_aside_and_no_earlier_one_overwritten(
    owner: Ownership, data: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    for number in (1, 2):
        owner.folder.episode_path(1, 2).write_bytes(data)
        with caplog.at_level(logging.WARNING):
            assert sorted(load_episodes(owner, CONFIG, 1)) == [0, 1, 3]
        assert f"set aside as 000001-00002.damaged-{number}" in lines(caplog, load_episodes)[-1]
    aside = [owner.folder.path / "episodes" / f"000001-00002.damaged-{n}" for n in (1, 2)]
    assert [path.read_bytes() for path in aside] == [data, data]


def test_what_other_weights_played_is_no_data(owner: Ownership) -> None:
    owner.write_episode(1, 3, played(1, 3, weights_attempt=2))
    assert sorted(load_episodes(owner, CONFIG, 1, oldest_attempt=2)) == [3]


def test_an_episode_of_another_version_stays_where_it_is(owner: Ownership) -> None:
    later = played(1, 2).replace(b"\xa6schema\x03", b"\xa6schema\x63")
    owner.write_episode(1, 2, later)
    before = names(owner)
    with pytest.raises(DataError, match=r"000001-00002\.bpne: episode: schema 99, this program"):
        load_episodes(owner, CONFIG, 1)
    assert names(owner) == before


def test_what_cannot_be_read_is_an_error_and_not_a_missing_episode(owner: Ownership) -> None:
    path = owner.folder.episode_path(1, 2)
    path.unlink()
    for make in (path.mkdir, lambda: os.mkfifo(path), lambda: path.symlink_to("000001-00001.bpne")):
        make()
        with pytest.raises(
            DataError, match=r"000001-00002\.bpne cannot be read: .*; mend or remove"
        ):
            load_episodes(owner, CONFIG, 1)
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
