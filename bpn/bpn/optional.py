"""Modules that need an extra which is not installed by default."""

from importlib import import_module
from typing import Any

from bpn_shared.errors import InputError


def load(module: str, *, extra: str, wanted_by: str) -> Any:
    """Imports a module of this distribution.

    Raises:
        InputError: what it needs is not installed; the message says how to install it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            f"{wanted_by} needs {error.name}, which is not installed: pip install 'bpn[{extra}]'"
        ) from error
