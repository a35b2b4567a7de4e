"""What a machine joins with: a word that is whole or refused."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_certificates.token import Token
from bpn_shared.errors import InputError

tokens = st.builds(
    Token,
    st.lists(st.text(min_size=1, max_size=40), max_size=8).map(tuple),
    st.integers(0, 65535),
    st.binary(min_size=32, max_size=32),
    st.binary(min_size=16, max_size=16),
)


@given(tokens)
def test_a_token_is_read_as_it_was_written(token: Token) -> None:
    assert Token.parse(str(token)) == token
    assert str(token).isascii()


@given(tokens, st.data())
def test_a_token_that_is_not_whole_is_refused(token: Token, data: st.DataObject) -> None:
    word = str(token)
    at = data.draw(st.integers(0, len(word) - 1))
    other = data.draw(st.sampled_from("abcXYZ019-_ \n\u00e9").filter(lambda c: c != word[at]))
    for wrong in (word[:at], word[:at] + other + word[at + 1 :], word + other):
        with contextlib.suppress(InputError):
            assert Token.parse(wrong) == token  # bits that base64 does not use


@given(st.text(max_size=100))
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        Token.parse(text)
