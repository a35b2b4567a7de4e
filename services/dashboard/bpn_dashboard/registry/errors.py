"""What the registry refuses, each with a message for whoever asked."""


class RegistryError(ValueError):
    """The base of what follows."""


class UnknownRunError(RegistryError):
    """There is no run of that id.

    Args:
        why: where it is instead, if that is known.
    """

    def __init__(self, run_id: str, why: str = "") -> None:
        super().__init__(why or f"there is no run {run_id}")


class UnknownSweepError(RegistryError):
    """There is no sweep of that id."""

    def __init__(self, sweep_id: str) -> None:
        super().__init__(f"there is no sweep {sweep_id}")


class StaleError(RegistryError):
    """Someone else changed it since it was read; the message says what to do."""


class RunBusyError(RegistryError):
    """The run has to be stopped first."""


class RunStateError(RegistryError):
    """A run in this state cannot do that."""


class ReadOnlyError(RegistryError):
    """Another dashboard serves the router; the message says which."""


class FilterError(RegistryError):
    """A filter, sort key or cursor is not one; the message names it and those there are."""
