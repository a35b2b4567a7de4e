"""The base of errors that are their user's to mend."""


class InputError(ValueError):
    """What was given is wrong; the message names it and the remedy. A command ends with status 2."""
