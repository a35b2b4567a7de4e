"""Reinforcement learning of robot control with binarized networks: runs, their policies, training and evaluation.

    run = bpn.train("reaching", seed=1)      # or bpn.open_run("runs/<id>")
    policy = run.policy()
    action = policy.act(observation)         # uint8[C, height, width]

What a name needs (torch, MuJoCo, a web client) is imported when it is used; `import bpn` alone is light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bpn.dashboard import Dashboard
    from bpn.evaluation.evaluate import Evaluation, evaluate
    from bpn.policy import Policy
    from bpn.run import Run, open_run
    from bpn.training import train

    __version__: str

_MODULES = {
    "Dashboard": "bpn.dashboard",
    "Evaluation": "bpn.evaluation.evaluate",
    "Policy": "bpn.policy",
    "Run": "bpn.run",
    "evaluate": "bpn.evaluation.evaluate",
    "open_run": "bpn.run",
    "train": "bpn.training",
}

__all__ = [
    "Dashboard",
    "Evaluation",
    "Policy",
    "Run",
    "__version__",
    "evaluate",
    "open_run",
    "train",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415

        return version("bpn")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
