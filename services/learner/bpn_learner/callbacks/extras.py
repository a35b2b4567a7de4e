"""Callbacks that need more than bpn-learner itself does: what that is comes with an extra of the same name."""

from importlib.util import find_spec

from bpn_shared import plugins
from bpn_shared.spec.config import ConfigError

_LIBRARIES = {"tensorboard": "tensorboard", "wandb": "wandb", "mlflow": "mlflow"}
"""By callback and extra: what is imported."""


def check_extra(callback: str) -> None:
    """Refuses a callback whose library is not here.

    Raises:
        ConfigError: the message names what to install.
    """
    library = _LIBRARIES.get(callback)
    if library is not None and not _is_installed(library):
        raise ConfigError(
            f"callback {callback!r} needs {library}, which is not installed: "
            f"pip install 'bpn-learner[{callback}]'"
        )


def usable_callbacks() -> tuple[str, ...]:
    """Names of those that are installed here with what they need; imports none of them."""
    installed = plugins.names(plugins.CALLBACKS)
    return tuple(n for n in installed if n not in _LIBRARIES or _is_installed(_LIBRARIES[n]))


def _is_installed(library: str) -> bool:
    spec = find_spec(library)
    return spec is not None and spec.origin is not None  # a folder of that name has none
