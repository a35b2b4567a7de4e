import argparse
import asyncio
import logging
import threading
from pathlib import Path

import pytest

from bpn_dashboard.api.context import Context
from bpn_dashboard.live import Live, stay_joined
from bpn_shared.bus import session


def test_what_keeps_the_bus_from_being_joined_is_said_once_and_tried_again(
    context: Context,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """As certificates that went after the start: new ones mend it, and until then the obstacle names them."""
    monkeypatch.setenv("BPN_CERTIFICATES", str(tmp_path / "gone"))
    monkeypatch.setattr("bpn_dashboard.live._AGAIN_S", 0.01)
    monkeypatch.setattr("bpn_dashboard.live._AGAIN_AT_MOST_S", 0.01)
    options = argparse.Namespace(connect="tls/127.0.0.1:7999", runs_dir=tmp_path)
    live, stop = Live(), threading.Event()
    asked: list[str] = []
    cannot = session.client_tls

    def noted(endpoint: str) -> dict[str, object]:
        asked.append(endpoint)
        return cannot(endpoint)

    monkeypatch.setattr(session, "client_tls", noted)
    assert live.obstacle() == "the message bus is not reached yet"

    async def watch() -> None:
        joining = asyncio.create_task(stay_joined(options, context, live, stop))
        tries = 0
        async with asyncio.timeout(10.0):
            while tries < 3:
                tries = len(asked)
                await asyncio.sleep(0)
        assert not joining.done()
        stop.set()
        await joining

    asyncio.run(watch())
    expected = f"{tmp_path}/gone/authority.pem cannot be read"
    assert expected in str(live.obstacle())
    errors = [record for record in caplog.records if record.levelno >= logging.ERROR]
    assert len(errors) == 1
    assert expected in errors[0].getMessage()
    assert not errors[0].exc_info
