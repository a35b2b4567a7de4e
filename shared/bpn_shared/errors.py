"""The base of errors that are their user's to mend, and what is said of any other."""


class InputError(ValueError):
    """What was given is wrong; the message names it and the remedy. A command ends with status 2."""


def one_line(error: BaseException) -> str:
    """What an exception says, in one line, with its kind where that says more than nothing."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {error.filename}" if error.filename else error.strerror
    said = " ".join(str(error).split())
    return f"{type(error).__name__}: {said}" if said else type(error).__name__
