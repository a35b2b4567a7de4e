"""The watcher's end of streams: everything at a key, or at all keys of a pattern, until it is closed."""

from collections.abc import Callable

import zenoh

from bpn_shared.bus.declared import Declared
from bpn_shared.bus.session import Bus

OnSample = Callable[[bytes, bytes], None]
"""Takes a message: attachment (empty if it has none) and payload."""


class Subscriber(Declared):
    """Calls `on_sample` with every message, on the network thread: it must be quick and raise nothing.

    A key without wildcards is counted in the session's traffic.
    """

    def __init__(self, bus: Bus, key: str, on_sample: OnSample) -> None:
        super().__init__()
        tally = None if "*" in key else bus.traffic.received(key)

        def receive(sample: zenoh.Sample) -> None:
            attachment, payload = sample.attachment, sample.payload.to_bytes()
            if tally is not None:
                tally.add(len(payload))
            on_sample(b"" if attachment is None else attachment.to_bytes(), payload)

        self._keep(
            bus.zenoh.declare_subscriber(key, zenoh.handlers.Callback(receive, indirect=False))
        )
