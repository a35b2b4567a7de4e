"""What is done during training beside it: the interface, and those that the project has."""

from bpn_learner.callbacks.callback import (
    Callback,
    CollectionEnd,
    EvaluationEnd,
    RunEnd,
    TrainingRun,
    UpdateEnd,
)

__all__ = [
    "Callback",
    "CollectionEnd",
    "EvaluationEnd",
    "RunEnd",
    "TrainingRun",
    "UpdateEnd",
]
