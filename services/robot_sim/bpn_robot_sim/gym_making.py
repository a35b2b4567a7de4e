"""Makes Gymnasium environments of somebody else: modules that register them, keyword arguments, wrappers.

What is asked for came with a configuration, from whoever may start runs. It makes no robot import at will,
nor read files: environments with MuJoCo take the path of their model as an argument.
"""

import importlib
import os
from collections.abc import Collection, Iterator
from typing import Any

import gymnasium

from bpn_shared.runtime.gym_modules import check_allowed
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.gym import GymOptions, id_of

_MAX_REASON = 300

# Without a display and speakers: pygame, which Gymnasium's own environments draw with, looks for both. `offscreen`
# draws; `dummy` would not in environments that take it for "nobody looks".
os.environ.setdefault("SDL_VIDEODRIVER", "offscreen")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")


def make(
    task: str, options: GymOptions, allowed: Collection[str], *, render: bool
) -> gymnasium.Env[Any, Any]:
    """The environment of a `gym:` task, wrapped as the options say.

    Args:
        allowed: modules that may be imported for it.
        render: whether it will be asked to render pictures.

    Raises:
        ConfigError: a module is not allowed or not installed, an argument names a file, or the environment or a
            wrapper cannot be made.
    """
    check_allowed(task, options, allowed)
    _check_arguments(task, options.arguments)
    module, env_id = id_of(task)
    if module:
        _register(task, module, env_id)
    asked = options.arguments | ({"render_mode": "rgb_array"} if render else {})
    try:
        env: Any = gymnasium.make(env_id, **asked)
    except Exception as error:  # whatever its constructor raises
        unknown = isinstance(error, gymnasium.error.UnregisteredEnv) and not module
        hint = "; of another package it is gym:MODULE:ID" if unknown else ""
        raise ConfigError(f"{task} cannot be made: {last_line(error)}{hint}") from error
    made: gymnasium.Env[Any, Any] = env
    for module, name in options.wrappers:
        made = _wrapped(made, task, module, name)
    return made


def _check_arguments(task: str, arguments: dict[str, Any]) -> None:
    for name, value in arguments.items():
        for text in _texts(value):
            if "/" in text or "\\" in text or text.startswith(("~", ".")):
                raise ConfigError(
                    f"{task}: {name} = {text[:_MAX_REASON]!r} may name a file, and no configuration says which "
                    "ones a robot reads: register an environment with it in a module of your own (gym:MODULE:ID)"
                )


def _texts(value: Any) -> Iterator[str]:
    """All in a value of JSON."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | dict):
        for inner in [*value, *value.values()] if isinstance(value, dict) else value:
            yield from _texts(inner)


def _register(task: str, module: str, env_id: str) -> None:
    """Imports what registers the environment; where that is not enough, calls the module's `register_envs`."""
    register = getattr(_imported(task, module), "register_envs", None)
    if env_id in gymnasium.registry or register in (None, gymnasium.register_envs):
        return
    try:
        register()
    except Exception as error:
        raise ConfigError(f"{task}: {module}.register_envs raised {last_line(error)}") from error


def _wrapped(env: Any, task: str, module: str, name: str) -> gymnasium.Env[Any, Any]:
    wrapper = getattr(_imported(task, module), name, None)
    if not callable(wrapper):
        raise ConfigError(f"{task}: {module} has no wrapper {name!r}")
    try:
        wrapped = wrapper(env)
    except Exception as error:
        raise ConfigError(
            f"{task}: the wrapper {module}:{name} cannot be made of the environment alone: {last_line(error)}"
        ) from error
    if not isinstance(wrapped, gymnasium.Env):
        raise ConfigError(
            f"{task}: {module}:{name} returned a {type(wrapped).__name__}, no environment"
        )
    return wrapped


def _imported(task: str, module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        needs = "" if error.name == module else f" needs {error.name}, which"
        raise ConfigError(
            f"{task}: the module {module}{needs} is not installed here: pip install the package that has it"
        ) from error
    except (Exception, SystemExit) as error:  # whatever it does when it is imported
        raise ConfigError(
            f"{task}: the module {module} cannot be imported: {last_line(error)}"
        ) from error


def last_line(error: BaseException) -> str:
    """An exception as the last line of its traceback has it, shortened."""
    lines = str(error).strip().splitlines()
    text = f"{type(error).__name__}: {lines[-1]}" if lines else type(error).__name__
    return text if len(text) <= _MAX_REASON else f"{text[:_MAX_REASON]}..."
