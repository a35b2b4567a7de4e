"""torch's settings, which callbacks share with the training in one process."""

import contextlib
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def settings_kept() -> Iterator[None]:
    """They, and torch's random state, are afterwards what they were, whatever the body makes of them."""
    threads, dtype, grad = (
        torch.get_num_threads(),
        torch.get_default_dtype(),
        torch.is_grad_enabled(),
    )
    deterministic = torch.are_deterministic_algorithms_enabled()
    warn_only = torch.is_deterministic_algorithms_warn_only_enabled()
    precision, state = torch.get_float32_matmul_precision(), torch.get_rng_state()
    tf32 = torch.backends.cudnn.allow_tf32
    try:
        yield
    finally:
        torch.set_rng_state(state)
        torch.set_float32_matmul_precision(precision)
        torch.backends.cudnn.allow_tf32 = tf32
        torch.use_deterministic_algorithms(deterministic, warn_only=warn_only)
        torch.set_grad_enabled(grad)
        torch.set_default_dtype(dtype)
        if torch.get_num_threads() != threads:
            torch.set_num_threads(threads)
