"""What a process has one of, and commands and the learner set for all of theirs."""

import contextlib
import logging
import signal
import sys
from collections.abc import Iterator

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def kept() -> Iterator[None]:
    """All of it is afterwards what it was, whatever the body makes of it."""
    root = logging.getLogger()
    levels = {logger: (logger.level, logger.disabled) for logger in (root, *_loggers())}
    logged_by, handlers = (
        root.handlers[:],
        {number: signal.getsignal(number) for number in _SIGNALS},
    )
    switch_interval_s = sys.getswitchinterval()
    with _torch_kept():
        try:
            yield
        finally:
            sys.setswitchinterval(switch_interval_s)
            for number, handler in handlers.items():
                if signal.getsignal(number) is not handler:
                    signal.signal(number, handler)
            root.handlers[:] = logged_by
            for logger, (level, disabled) in levels.items():
                logger.disabled = disabled
                if logger.level != level:  # setting it is slow
                    logger.setLevel(level)


def _loggers() -> Iterator[logging.Logger]:
    for logger in list(logging.root.manager.loggerDict.values()):
        if isinstance(logger, logging.Logger):  # not only a place in the tree
            yield logger


def _torch_kept() -> contextlib.AbstractContextManager[None]:
    if "torch" not in sys.modules:
        return contextlib.nullcontext()
    from bpn_learner.callbacks.settings import settings_kept

    return settings_kept()
