"""Certificates that are renewed on disk, and ones that nobody renews: noticed in time."""

import hashlib
import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

from bpn_shared.bus.certificates import CertificateFiles
from bpn_shared.bus.obstacle import own_obstacle
from bpn_shared.bus.x509 import Life, facts_of
from bpn_shared.errors import one_line

log = logging.getLogger(__name__)

_LOOK_AGAIN_S = 10.0
_SAY_AGAIN_S = 86_400.0
_SAY_EXPIRED_AGAIN_S = 3600.0


class CertificateWatch:
    """Looks at a service's certificates from time to time.

    Args:
        now_s: the clock of what is said again, seconds.

    Attributes:
        life: of the certificate that people should renew first, the service's own or the authority's, as `warn`
            last read it; None: it never could.
    """

    def __init__(
        self, files: CertificateFiles, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._files, self._now_s = files, now_s
        self._used = self._digest()
        self._looked_s: float | None = None
        self._said_s: float | None = None
        self._said_expired = False
        self.life: Life | None = None

    def _digest(self) -> bytes:
        try:
            return hashlib.sha256(b"\0".join(path.read_bytes() for path in self._files)).digest()
        except OSError:
            return b""  # in the middle of being replaced, or gone: no reason to do anything

    def renewed(self) -> bool:
        """Whether there are others than those in use, and they can be used; from then on they are in use."""
        found = self._digest()
        if found in (b"", self._used) or own_obstacle(self._files):
            return False
        self._used, self._said_s, self._looked_s = found, None, None
        return True

    def warn(self) -> None:
        """Says once a day that a certificate is near its end, and once an hour that it is past it."""
        if self._looked_s is not None and self._now_s() - self._looked_s < _LOOK_AGAIN_S:
            return
        self._looked_s, now = self._now_s(), datetime.now(UTC)
        try:
            self.life, path = _first_to_renew(self._files, now)
        except (OSError, ValueError) as error:
            self._say(f"the certificate cannot be read: {one_line(error)}", expired=True)
            return
        left, when = self.life.left(now), f"{self.life.end:%Y-%m-%d %H:%M:%S} UTC"
        if left <= timedelta(0):
            self._say(f"certificate {path} expired {when}", expired=True)
        elif self.life.is_near_end(now):
            self._say(f"certificate {path} ends in {left / timedelta(days=1):.1f} days, {when}")

    def _say(self, what: str, *, expired: bool = False) -> None:
        now_s, again_s = self._now_s(), _SAY_EXPIRED_AGAIN_S if expired else _SAY_AGAIN_S
        news = self._said_s is None or expired > self._said_expired
        if news or (self._said_s is not None and now_s - self._said_s >= again_s):
            log.log(
                logging.ERROR if expired else logging.WARNING,
                "%s: renew it with `bpn-certificates`",
                what,
            )
            self._said_s, self._said_expired = now_s, expired


def _first_to_renew(files: CertificateFiles, now: datetime) -> tuple[Life, Path]:
    """Of the certificates that a service needs, the one whose end is near, or else the one that ends first."""
    lives = [(facts_of(path).life, path) for path in (files.certificate, files.authority)]
    return min(lives, key=lambda each: (not each[0].is_near_end(now), each[0].end))
