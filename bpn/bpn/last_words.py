"""Why a service ended, from what it said last."""

from pathlib import Path

from bpn_shared.messages import log_lines

_TAIL_BYTES = 64 * 1024
_ERRORS = ("ERROR", "CRITICAL")


def last_words(log: Path, begin: int = 0) -> str:
    """The reason in a service's log: its last error, or the last line of what it did not foresee; empty: none.

    Args:
        begin: where in the file the process began to write.
    """
    try:
        with log.open("rb") as file:
            end = file.seek(0, 2)
            file.seek(max(begin, end - _TAIL_BYTES))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError:
        return ""
    return _reason([line for line in lines if line.strip()])


def _reason(lines: list[str]) -> str:
    parsed = [log_lines.parse(line) for line in lines]
    ours = [line for line in parsed if line.service is not None]
    errors = [line.message for line in ours if line.level in _ERRORS]
    if parsed and parsed[-1].service is None and not (ours and ours[-1].level in _ERRORS):
        return parsed[-1].message.strip()  # a traceback's end, or an option that is not known
    return errors[-1] if errors else ""
