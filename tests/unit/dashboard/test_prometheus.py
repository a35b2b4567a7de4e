"""/metrics has a sample of everything that an alarm may watch, before it happens the first time."""

from importlib.metadata import version

from bpn_shared.runs.state import STATES
from bpn_shared.spec.config import RunConfig


def test_every_state_has_a_sample_and_the_program_says_which_it_is(client, store) -> None:
    store.create(RunConfig(), actor="test")
    text = client.get("/metrics").text
    for state in STATES:
        count = 1.0 if state == "queued" else 0.0
        assert f'bpn_runs{{state="{state}"}} {count}' in text
    assert f'version="{version("bpn-shared")}"' in text
