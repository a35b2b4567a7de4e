"""Callbacks that a test installs: one that notes all, and others that do what they should not."""

# ruff: noqa: ARG001, ARG002 - the hooks have these arguments

import sys
from typing import Any, ClassVar

import torch

from bpn_learner.callbacks import Callback


class Seen(Callback):
    calls: ClassVar[list[tuple[Any, ...]]] = []

    def on_collection_end(self, end: Any) -> None:
        self.calls.append(("collection", end.iteration, len(end.returns), set(end.lengths)))

    def on_update_end(self, end: Any) -> None:
        self.run.add("twice", 2.0 * end.iteration)
        self.calls.append(
            ("update", end.iteration, "eval_return" in end.record, end.weights.version)
        )

    def on_evaluation_end(self, end: Any) -> None:
        self.calls.append(("evaluation", end.iteration, len(end.returns), end.version))

    def on_run_end(self, end: Any) -> None:
        self.calls.append(("run", end.finished, end.reason))


class Bad(Callback):
    def on_collection_end(self, end: Any) -> None:
        raise KeyError("collection")

    def on_update_end(self, end: Any) -> None:
        end.record["return_px"] = 1e9
        end.record.clear()
        self.run.add("loss", 0.0)

    def on_evaluation_end(self, end: Any) -> None:
        sys.exit(1)

    def on_run_end(self, end: Any) -> None:
        raise OSError("run")


class Odd(Callback):
    errors: ClassVar[list[str]] = []

    def on_update_end(self, end: Any) -> None:
        for ask in (
            lambda: self.run.add("odd", float("nan")),
            lambda: self.run.add("odd", float("inf")),
            lambda: self.run.add("sha256", 0.0),
            lambda: self.run.add("", 0.0),
            lambda: self.run.add("a b", 0.0),
            lambda: self.run.add("x" * 65, 0.0),
            lambda: self.run.evaluate(0),
            lambda: self.run.stop(" "),
            lambda: self.run.keep_best(1, "odd", float("nan")),
        ):
            try:
                ask()
            except ValueError as error:
                self.errors.append(str(error))


class Talkative(Callback):
    def on_update_end(self, end: Any) -> None:
        for number in range(60):
            self.run.add(f"metric_{end.iteration}_{number}", 0.0)


class Endless(Callback):
    def on_evaluation_end(self, end: Any) -> None:
        self.run.evaluate(1)


class Meddler(Callback):
    def meddle(self, _end: object = None) -> None:
        torch.set_num_threads(torch.get_num_threads() + 1)
        torch.set_default_dtype(torch.float64)
        torch.set_grad_enabled(False)
        torch.use_deterministic_algorithms(not torch.are_deterministic_algorithms_enabled())
        torch.set_float32_matmul_precision("medium")
        torch.backends.cudnn.allow_tf32 = not torch.backends.cudnn.allow_tf32
        torch.manual_seed(99)

    def __init__(self, run: Any) -> None:
        super().__init__(run)
        self.meddle()

    on_collection_end = on_update_end = on_evaluation_end = meddle


class Late(Callback):
    def on_update_end(self, end: Any) -> None:
        if end.iteration + 1 == self.run.config.iterations:
            self.run.stop("good enough")


def unmade(run: object) -> None:
    raise ZeroDivisionError("no")
