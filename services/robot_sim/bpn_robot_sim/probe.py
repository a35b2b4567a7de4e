"""Whether a Gymnasium environment can be a task: it is made, played at random for a moment, and closed.

`python -m bpn_robot_sim.probe gym:CartPole-v1` prints what was found as JSON; `probe_in_child` calls that, so that
an environment that prints, hangs or crashes does so in a process of its own.
"""

import argparse
import contextlib
import os
import subprocess
import sys
from collections.abc import Collection, Iterator
from typing import TextIO

from bpn_robot_sim.robots import of_gym
from bpn_shared.bus.requests import RefusedError
from bpn_shared.errors import InputError
from bpn_shared.messages.probe import MAX_SENTENCE, ProbeReply, ProbeRequest
from bpn_shared.runtime.gym_modules import add_gym_modules, allowed_modules, as_arguments
from bpn_shared.runtime.probing import TIMEOUT_S
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.gym import GymOptions
from bpn_shared.spec.tasks import is_gym

_REFUSED = 3
"""Exit status of the child that found a reason against."""


def probe_environment(asked: ProbeRequest, allowed: Collection[str] = ()) -> ProbeReply:
    """Makes, plays and closes the environment, in this process.

    Args:
        allowed: modules that may be imported for it.

    Raises:
        ConfigError: it cannot be a task, or what it needs is not installed; the message is one sentence.
    """
    if not is_gym(asked.task):
        raise ConfigError(f"{asked.task} is no gym: task, and needs no probe")
    play_at_random, unlike = of_gym("trying_out:play_at_random"), of_gym("trying_out:unlike")
    options = GymOptions(**{name: getattr(asked, name) for name in GymOptions.model_fields})
    env = of_gym("environment:GymEnvironment")(asked.task, options, allowed)
    with contextlib.closing(env):
        times = 2 if asked.steps else 1  # a robot that may not move is not moved to its start twice
        plays = [
            play_at_random(env, asked.task, asked.frame_channels, asked.steps) for _ in range(times)
        ]
        notes = [env.note]
        if (what := unlike(plays[0], plays[-1])) is not None:
            notes.append(
                f"{asked.task}: equal seeds and actions gave {what}, so runs of it do not repeat"
            )
        return ProbeReply(
            actions=sum(env.dims),
            dims=env.dims,
            seen="renders" if env.renders else "observations",
            note="; ".join(note for note in notes if note)[:MAX_SENTENCE],
        )


def probe_in_child(
    asked: ProbeRequest, allowed: Collection[str] = (), *, timeout_s: float = TIMEOUT_S
) -> ProbeReply:
    """`probe_environment` in a process of its own, whose standard output never mixes with ours.

    Raises:
        ConfigError: the environment cannot be a task; the message is one sentence.
    """
    command = [sys.executable, "-m", "bpn_robot_sim.probe", asked.task, *as_arguments(allowed)]
    try:
        done = subprocess.run(  # noqa: S603 - this module, with values that its parser checks
            [*command, "--asked", asked.model_dump_json()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ConfigError(
            f"{asked.task} cannot be a task: making it and {asked.steps} steps took longer than {timeout_s:g} s"
        ) from None
    said = done.stdout.decode(errors="replace").strip()
    if done.returncode == _REFUSED and said:
        raise ConfigError(said)
    if done.returncode != 0:
        raise ConfigError(
            f"{asked.task} cannot be a task: its process ended with status {done.returncode} while it was "
            "tried out"
        )
    return ProbeReply.model_validate_json(said)


def answer(body: bytes, allowed: Collection[str] = ()) -> bytes:
    """A robot worker's answer to a probe over the bus (`bpn_shared.runtime.probing`).

    Raises:
        MessageError: no such request.
        RefusedError: the environment cannot be a task.
    """
    asked = ProbeRequest.decode(body)
    try:
        return probe_in_child(asked, allowed).encode()
    except ConfigError as error:
        raise RefusedError(str(error)) from error


def main(argv: list[str] | None = None) -> int:
    """Prints the reply as JSON, or the sentence why not; exit status 3 then."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("task")
    parser.add_argument("--channels", type=int, choices=(1, 3), default=1)
    parser.add_argument("--steps", type=int, default=ProbeRequest.model_fields["steps"].default)
    parser.add_argument("--asked", metavar="JSON", help="the request, with everything there is")
    add_gym_modules(parser)
    options = parser.parse_args(argv)
    asked = (
        ProbeRequest.model_validate_json(options.asked)
        if options.asked
        else ProbeRequest(task=options.task, frame_channels=options.channels, steps=options.steps)
    )
    with _stdout_kept() as out:
        try:
            allowed = allowed_modules(options.gym_modules)
            said, status = probe_environment(asked, allowed).model_dump_json(), 0
        except InputError as error:
            said, status = str(error), _REFUSED
        out.write(f"{said}\n")
    return status


@contextlib.contextmanager
def _stdout_kept() -> Iterator[TextIO]:
    """Standard output for us alone: whatever else is printed, by C code too, goes to standard error."""
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as kept:
        os.dup2(2, 1)
        yield kept


if __name__ == "__main__":
    raise SystemExit(main())
