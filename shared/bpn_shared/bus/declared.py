"""What stands in a session, from its making to its end."""

import contextlib
from typing import Any, Protocol, TypeVar

import zenoh

from bpn_shared.closing import Closing


class Declaration(Protocol):
    """A subscriber, publisher, queryable or token of Zenoh's."""

    def undeclare(self) -> Any: ...


D = TypeVar("D", bound=Declaration)


class Declared(Closing):
    """Stands in a session until it is closed, which a `with` does, or until the session is."""

    def __init__(self) -> None:
        self._declarations: list[Declaration] = []

    def _keep(self, declaration: D) -> D:
        """Has the declaration end with this."""
        self._declarations.append(declaration)
        return declaration

    def close(self) -> None:
        """Ends it. Closing it again does nothing."""
        while self._declarations:
            with contextlib.suppress(zenoh.ZError):  # the session has ended, and it with it
                self._declarations.pop().undeclare()
