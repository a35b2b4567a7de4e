"""Which formats there are, what each writes, and what it needs."""

import secrets
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bpn import optional
from bpn.outputs import check_output
from bpn.run import Run, Version
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.errors import InputError

Written = list[Path]


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        help: what it is, in a few words.
        name: of what is written where no other is asked for; {run} is the end of the run's id.
        write: takes run, version and path; returns the files that it wrote.
        is_folder: whether it writes a folder, which must not be there yet.
    """

    help: str
    name: str
    write: Callable[[Run, Version, Path], Written]
    is_folder: bool = False


def export(
    run: Run, form: str, path: Path | str | None = None, *, version: Version = None
) -> Written:
    """Writes a run, or its policy, in another format.

    Args:
        form: one of `FORMATS`.
        path: file or folder; None: the format's name in the working directory.
        version: of the weights, for formats of policies.

    Returns:
        The files that were written.

    Raises:
        InputError: the format is unknown or not for this run, or the path cannot be written.
    """
    if form not in FORMATS:
        raise InputError(f"format = {form!r} is unknown; one of: {', '.join(FORMATS)}")
    found = FORMATS[form]
    path = Path(path or found.name.format(run=run.id[-12:]))
    if found.is_folder:
        if path.exists():
            raise InputError(f"{path} is there already: choose another name, or remove it")
    else:
        check_output("--output", path, (Path(found.name).suffix,))
    # Whole or not at all, and what stood there stays until then.
    unfinished = path.with_name(f".{secrets.token_hex(4)}-{path.name}")
    try:
        written = found.write(run, version, unfinished)
        unfinished.replace(path)
    finally:
        if unfinished.is_dir():
            shutil.rmtree(unfinished)
        unfinished.unlink(missing_ok=True)
    return [path / file.relative_to(unfinished) for file in written]


def _binarized(run: Run, version: Version, form: str) -> WeightBlob:
    weights = run.weights(version)
    if not isinstance(weights, WeightBlob):
        raise InputError(
            f"format {form} is for binarized policies; this one ({run.config.algorithm}) is float: choose onnx"
        )
    return weights


def _onnx(run: Run, version: Version, path: Path) -> Written:
    weights = run.weights(version)
    if isinstance(weights, FloatWeights):
        path.write_bytes(weights.model)
    else:
        from bpn.export.onnx_graph import encode, onnx_model  # noqa: PLC0415

        path.write_bytes(encode(onnx_model(weights)))
    return [path]


def _qonnx(run: Run, version: Version, path: Path) -> Written:
    from bpn.export.onnx_graph import encode, qonnx_model  # noqa: PLC0415

    path.write_bytes(encode(qonnx_model(_binarized(run, version, "qonnx"))))
    return [path]


def _c(run: Run, version: Version, path: Path) -> Written:
    from bpn.export.c_source import c_source  # noqa: PLC0415

    path.write_text(c_source(_binarized(run, version, "c"), run.config.task_spec))
    return [path]


def _csv(run: Run, _version: Version, path: Path) -> Written:
    from bpn.export.tables import metrics_table, write_csv  # noqa: PLC0415

    write_csv(metrics_table(run), path)
    return [path]


def _parquet(run: Run, _version: Version, path: Path) -> Written:
    from bpn.export.tables import write_parquet  # noqa: PLC0415

    return write_parquet(run, path)


def _lerobot(run: Run, _version: Version, path: Path) -> Written:
    module = optional.load("bpn.export.lerobot", extra="data", wanted_by="format lerobot")
    written: Written = module.write(run, path)
    return written


def _mp4(run: Run, _version: Version, path: Path) -> Written:
    video = optional.load("bpn.evaluation.video", extra="media", wanted_by="format mp4")
    newest = max((int(name[:6]) for name in run.folder.file_names("episodes")), default=None)
    episodes = list(run.episodes(newest))
    if not episodes:
        raise InputError(f"run {run.id} has no episodes yet")
    video.write(path, episodes, run.config.task_spec)
    return [path]


FORMATS = {
    "onnx": Format("the policy for any ONNX runtime, to the last bit", "{run}.onnx", _onnx),
    "qonnx": Format("a binarized policy for FINN and hls4ml", "{run}.qonnx.onnx", _qonnx),
    "c": Format("a binarized policy as one C99 file without heap", "{run}.c", _c),
    "csv": Format("the metrics of every iteration", "{run}.csv", _csv),
    "parquet": Format("metrics, and the steps of all episodes", "{run}-tables", _parquet, True),
    "lerobot": Format("all episodes as a LeRobot dataset, v3", "{run}-lerobot", _lerobot, True),
    "mp4": Format("a film of the newest iteration's episodes", "{run}.mp4", _mp4),
}
