"""The base of errors that end a command."""


class CommandError(RuntimeError):
    """The command could not do what was asked; the message says why. It ends with status 1."""
