import io
import logging
import time

from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.messages import log_lines


@given(st.text(), st.sampled_from(log_lines.LEVELS))
def test_what_is_written_is_read_again(message: str, level: str) -> None:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(log_lines.formatter("edge-0"))
    before = time.time()
    record = logging.LogRecord(
        "bpn", logging.getLevelNamesMapping()[level], "", 0, message, None, None
    )
    handler.emit(record)
    line = log_lines.parse(stream.getvalue().removesuffix("\n"))
    assert (line.service, line.level, line.message) == ("edge-0", level, message)
    assert line.time_unix_s is not None
    assert before - 0.002 <= line.time_unix_s <= time.time()  # milliseconds are cut off


@given(st.text())
def test_any_text_is_a_line(text: str) -> None:
    assert log_lines.parse(text).message in text


def test_lines_that_only_look_like_ours_are_all_message() -> None:
    for text in (
        "2026-13-40T08:22:35.123Z edge-0 INFO no such month",
        "2026-11-22T08:22:35.123Z edge-0 LOUD no such level",
        '  File "x.py", line 3, in f',
        "",
    ):
        assert log_lines.parse(text) == (None, None, "INFO", text)
