"""Alerts to an address outside, signed, so that whoever receives them can tell that they are ours."""

import hashlib
import hmac
import http.client
import json
import logging
import queue
import threading
import time
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit

from bpn_shared.backoff import Backoff
from bpn_shared.counters import Counters
from bpn_shared.errors import one_line
from bpn_shared.spec.config import ConfigError

log = logging.getLogger(__name__)

SIGNATURE = "X-Bpn-Signature"
"""Header: `t=SECONDS,v1=HEX`, HEX being HMAC-SHA256 over `SECONDS.BODY` with the secret."""
TIMEOUT_S = 10.0
TRIES = 6
_FIRST_S, _MOST_S = 1.0, 60.0
_WAITING = 200
_LEAST_SECRET_BYTES = 16
_HOPELESS = range(400, 500)
_AGAIN = (408, 425, 429)


@dataclass(frozen=True)
class Webhook:
    """Where alerts go, and the secret that signs them."""

    url: str
    secret: bytes

    @classmethod
    def read(cls, url: str, secret_file: Path) -> "Webhook":
        """Checks both.

        Raises:
            ConfigError: the URL is no plain http or https one, or the secret cannot be read or is too short.
        """
        if not _is_plain(url):
            raise ConfigError(
                f"--alert-webhook {url}: must be http://NAME... or https://NAME..., without a user, and what is "
                "not ASCII or a space in it written as %XX"
            )
        try:
            secret = secret_file.read_bytes().strip()
        except OSError as error:
            raise ConfigError(f"--alert-secret {secret_file}: {error.strerror}") from error
        if len(secret) < _LEAST_SECRET_BYTES:
            raise ConfigError(
                f"--alert-secret {secret_file}: must have {_LEAST_SECRET_BYTES} bytes or more, such as from "
                "`openssl rand -hex 32`"
            )
        return cls(url, secret)


def _is_plain(url: str) -> bool:
    """Whether a request can be sent there."""
    try:
        parts = urlsplit(url)
        return (
            parts.scheme in ("http", "https")
            and bool(parts.hostname)
            and parts.username is None
            and parts.port != 0
            and url.isascii()
            and url.isprintable()
            and " " not in url
        )
    except ValueError:  # its port is no number, or its address none
        return False


def signature(secret: bytes, at_s: int, body: bytes) -> str:
    """The value of the header."""
    digest = hmac.new(secret, b"%d." % at_s + body, hashlib.sha256).hexdigest()
    return f"t={at_s},v1={digest}"


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """To no other address than the operator's."""

    def redirect_request(self, *_arguments: Any) -> None:
        return None


class Deliveries:
    """Sends alerts one after the other, each so often at most; a queue holds those that wait.

    Args:
        counters: `alerts_sent`, `alerts_not_sent`.

    Attributes:
        trouble: why the last one could not be sent; empty: it could.
    """

    def __init__(
        self,
        webhook: Webhook,
        counters: Counters,
        stop: threading.Event,
        *,
        first_s: float = _FIRST_S,
    ) -> None:
        self._webhook, self._counters, self._stop = webhook, counters, stop
        self._first_s = first_s
        self._waiting: queue.Queue[Mapping[str, Any]] = queue.Queue(_WAITING)
        # No proxy of the environment: the operator named the address.
        self._opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), _NoRedirect)
        self.trouble = ""

    def put(self, alert: Mapping[str, Any]) -> None:
        """Sends it soon. One that finds no place is counted, and stands in the list of alerts all the same."""
        try:
            self._waiting.put_nowait(alert)
        except queue.Full:
            self._not_sent(f"more than {_WAITING} alerts wait to be sent")

    def follow(self) -> None:
        """Sends until it is to stop."""
        while not self._stop.is_set():
            try:
                alert = self._waiting.get(timeout=0.5)
            except queue.Empty:
                continue
            self._deliver(json.dumps(alert).encode())

    def _deliver(self, body: bytes) -> None:
        backoff = Backoff(self._first_s, _MOST_S)
        for attempt in range(1, TRIES + 1):
            reason, again = self._try(body)
            if not reason:
                self.trouble = ""
                self._counters.add("alerts_sent")
                return
            self.trouble = reason
            if not again or attempt == TRIES or self._stop.wait(backoff.next_s()):
                self._not_sent(f"{reason}, after {attempt} tries")
                return

    def _try(self, body: bytes) -> tuple[str, bool]:
        """Why it failed, empty if it did not; and whether it may do later."""
        now_s = int(time.time())
        request = urllib.request.Request(  # noqa: S310 - of a scheme that was checked
            self._webhook.url,
            data=body,
            method="POST",
            headers={
                "Content-Type": "application/json",
                "User-Agent": "bpn-dashboard",
                SIGNATURE: signature(self._webhook.secret, now_s, body),
            },
        )
        try:
            with self._opener.open(request, timeout=TIMEOUT_S):
                return "", False
        except HTTPError as error:
            error.close()
            again = error.code not in _HOPELESS or error.code in _AGAIN
            redirected = HTTPStatus.MULTIPLE_CHOICES <= error.code < HTTPStatus.BAD_REQUEST
            said = "redirects, which is not followed" if redirected else "refuses it"
            return f"the webhook {said} ({error.code})", again and not redirected
        except (URLError, OSError, UnicodeError, http.client.HTTPException) as error:
            return f"the webhook cannot be reached: {one_line(error)}", True

    def _not_sent(self, reason: str) -> None:
        self.trouble = reason
        self._counters.add("alerts_not_sent")
        log.warning("an alert is not sent: %s", reason)
