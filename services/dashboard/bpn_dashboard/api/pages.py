"""Cursors: where a page ends, opaque to clients, good only for the list that it was made for."""

import base64
import hashlib
import hmac
import json
from typing import Any

from bpn_dashboard.api.problems import ApiError

_TAG_BYTES = 16


class Cursors:
    """Writes and reads cursors. One that was altered, or is another list's, is refused.

    Args:
        key: the secret that authenticates them.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key

    def encode(self, value: Any, scope: Any) -> str:
        """A cursor.

        Args:
            value: JSON of where to go on.
            scope: JSON of what list it belongs to: its filter and order.
        """
        data = json.dumps(value).encode()
        return base64.urlsafe_b64encode(self._tag(data, scope) + data).decode().rstrip("=")

    def decode(self, cursor: str, scope: Any) -> Any:
        """What `encode` was given.

        Raises:
            ApiError: it is none, or another list's.
        """
        try:
            raw = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True)
        except ValueError:
            raw = b""
        tag, data = raw[:_TAG_BYTES], raw[_TAG_BYTES:]
        if not hmac.compare_digest(tag, self._tag(data, scope)):
            raise ApiError(
                422, "cursor", "the cursor is not one of this list; begin again without it"
            )
        return json.loads(data)

    def _tag(self, data: bytes, scope: Any) -> bytes:
        context = json.dumps(scope, sort_keys=True, default=str).encode()
        digest = hashlib.sha256(context).digest()
        return hmac.digest(self._key, digest + data, "sha256")[:_TAG_BYTES]
