import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bpn import stall_notice
from bpn.stall_notice import LocalStalls, StallNotice
from bpn_shared.runtime import watchdog


def test_a_reason_is_said_once_another_one_again_and_the_end_once() -> None:
    said: list[str] = []
    notice = StallNotice(said.append)
    for reason, for_s in [
        ("", 1), ("2 runs before it", 3), ("it waits", 30), ("it waits", 31),
        ("it is full", 40), ("it is full", 50), ("", 0), ("", 0),
    ]:  # fmt: skip
        notice.update(reason, for_s)
    assert said == [
        "waiting: 2 runs before it",
        "no progress for 30 s: it waits",
        "no progress for 40 s: it is full",
        "goes on after 50 s",
    ]


def test_a_local_run_that_stands_still_says_so_until_an_iteration_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    free: dict[str, Any] = {"free": 2**40}
    monkeypatch.setattr(
        stall_notice.shutil, "disk_usage", lambda _: SimpleNamespace(free=free["free"])
    )
    said: list[str] = []
    stalls = LocalStalls(20, tmp_path, StallNotice(said.append))
    now_s[0] = watchdog.STALLED_AFTER_S - 1
    stalls.look(0, connected=False)
    assert said == []
    now_s[0] += 1
    stalls.look(0, connected=False)
    assert said == ["no progress for 30 s: the router is not reached"]
    free["free"] = 3 * 2**20
    stalls.look(0, connected=True)
    assert said[1].endswith(f"the disk of {tmp_path} is nearly full: 3 MiB are left")
    stalls.look(1, connected=True)
    assert said[2:] == ["goes on after 30 s"]
