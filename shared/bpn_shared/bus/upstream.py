"""A router's line to another site's: says when it is lost, why, and when it is back."""

import logging
import time

import zenoh

from bpn_shared.backoff import Backoff
from bpn_shared.bus.certificates import CertificateFiles
from bpn_shared.bus.obstacle import obstacle

log = logging.getLogger(__name__)


class UpstreamLine:
    """Whether the other router is reached, as one who looks from time to time knows it.

    Args:
        endpoint: of the other router; None: there is none, and nothing to say.
        files: with which it is reached.
    """

    def __init__(self, endpoint: str | None, files: CertificateFiles | None) -> None:
        self._endpoint, self._files = endpoint, files
        self._backoff = Backoff(2.0, 60.0)
        self._said: str | None = ""
        """Why it is not reached, as was said last, as far as it was known; None: it is reached."""
        self._look_why_s = 0.0

    def look(self, session: zenoh.Session) -> None:
        """Says what has changed since the last look."""
        if self._endpoint is None:
            return
        if session.info.routers_zid():
            if self._said is not None:
                log.info("joined the router at %s", self._endpoint)
            self._said = None
            self._backoff.reset()
        elif time.monotonic() >= self._look_why_s or self._said is None:
            self._look_why_s = time.monotonic() + self._backoff.next_s()
            why = obstacle(self._endpoint, self._files)
            if why != self._said and (why or self._said is None):  # one that answers is joined soon
                reason = f": {why}" if why else ""
                log.warning("the router at %s is not joined%s", self._endpoint, reason)
                self._said = why
