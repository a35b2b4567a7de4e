"""Who hears of what becomes of runs, after it is stored and on the thread that did it: hearing must be quick."""

from collections.abc import Callable, Collection, Sequence

from bpn_dashboard.database.tables import RunRow

Listener = Callable[[Sequence[RunRow]], None]
"""Takes the rows that have changed."""

Mourner = Callable[[Collection[str]], None]
"""Takes the ids of runs that are not there any more."""


class Audience:
    """Its methods may be called from any thread."""

    def __init__(self) -> None:
        self._listeners: list[Listener] = []
        self._mourners: list[Mourner] = []

    def subscribe(self, listener: Listener) -> None:
        """From now on `listener` hears of every change."""
        self._listeners.append(listener)

    def unsubscribe(self, listener: Listener) -> None:
        """Ends that."""
        self._listeners.remove(listener)

    def mourn(self, mourner: Mourner) -> None:
        """From now on `mourner` hears of the runs that go, however they go."""
        self._mourners.append(mourner)

    def tell(self, rows: Sequence[RunRow]) -> None:
        """These rows have changed."""
        for listener in tuple(self._listeners) if rows else ():
            listener(rows)

    def tell_gone(self, run_ids: Collection[str]) -> None:
        """These runs are not there any more."""
        for mourner in tuple(self._mourners) if run_ids else ():
            mourner(run_ids)
