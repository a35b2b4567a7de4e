from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn.last_words import last_words

AT = "2026-11-22T08:22:35.123Z edge-0"
TRACEBACK = "Traceback (most recent call last):\n  File x\nValueError: seven"


@pytest.mark.parametrize(
    ("log", "reason"),
    [
        ("", ""),
        (f"{AT} INFO starts\n", ""),
        (f"{AT} ERROR no GPU\n", "no GPU"),
        (f"{AT} ERROR no GPU\n{AT} INFO ends\n", "no GPU"),
        (f"{AT} INFO starts\n{TRACEBACK}\n", "ValueError: seven"),
        (f"{AT} ERROR ValueError: a b\n{TRACEBACK}\n", "ValueError: a b"),
        (f"{AT} ERROR early\n{AT} INFO goes on\n{TRACEBACK}\n\n", "ValueError: seven"),
        ("usage: bpn-edge\nbpn-edge: error: --slot\n", "bpn-edge: error: --slot"),
    ],
)
def test_the_reason_is_the_last_error_or_what_came_unforeseen(
    log: str, reason: str, tmp_path: Path
) -> None:
    file = tmp_path / "edge-0.log"
    file.write_text(log)
    assert last_words(file) == reason


def test_what_an_earlier_process_said_is_no_reason(tmp_path: Path) -> None:
    file = tmp_path / "edge-0.log"
    file.write_text(f"{AT} ERROR earlier\n")
    begin = file.stat().st_size
    assert last_words(file, begin) == ""
    with file.open("a") as log:
        log.write(f"{AT} ERROR now\n")
    assert last_words(file, begin) == "now"
    assert last_words(tmp_path / "nothing.log") == ""


@given(st.binary(max_size=2000))
def test_any_log_has_a_reason_of_one_line(
    tmp_path_factory: pytest.TempPathFactory, log: bytes
) -> None:
    file = tmp_path_factory.mktemp("log") / "edge-0.log"
    file.write_bytes(log)
    assert "\n" not in last_words(file)
