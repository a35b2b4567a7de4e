"""Weights as programs of before made them: equal bits on machines of one type alone."""

from typing import Any

import torch

from bpn_learner.minibatch import available_paths


def is_like(maker: dict[str, Any]) -> bool:
    """Whether this machine rounds as the one did that made the golden bits."""
    return (maker["torch"], maker["path"]) == (torch.__version__, available_paths()[0])
