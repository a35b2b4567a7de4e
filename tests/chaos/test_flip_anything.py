"""Whatever happens to a file of a run's folder: the run ends as if nothing had, or says in a line why it cannot.

A short run is interrupted. In copies of its folder a bit of a random file is flipped, or the file is cut, emptied
or removed, and the copy is resumed by the `bpn` command with its real services.
"""

import json
import os
import random
import shutil
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from bpn.cli import main
from bpn.local_run import new_run, private_endpoint, run_to_end
from bpn.summary import summarize
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

CASES = 300 if os.environ.get("BPN_CHAOS") else 12
CONFIG = RunConfig.for_task(
    "reaching",
    seed=5,
    iterations=5,
    episodes=2,
    steps=2,
    epochs=2,
    batch_size=2,
    hidden_units=1,
    replay_iterations=2,
)
GOLDEN = Path(__file__).parents[1] / "golden"
GOLDEN_SHA256 = "dd6664fad82efa274249a4fa074d0cac42c0dee7e1361d9dd6904feb12dc0282"
KINDS = (
    "checkpoint.safetensors", "episodes/*", "metrics.jsonl", "rewards.jsonl", "weights/*",
    "config.json", "state.json", "about.json", "logs/*", ".lock",
)  # fmt: skip


class Interrupted(NamedTuple):
    """A run that was stopped after some iterations, and what it would have come to."""

    folder: RunFolder
    weights_sha256: str


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> Interrupted:
    whole = new_run(tmp_path_factory.mktemp("whole"), CONFIG)
    run_to_end(whole, endpoint=private_endpoint(), stop=threading.Event())
    folder = new_run(tmp_path_factory.mktemp("interrupted"), CONFIG)
    stop = threading.Event()

    def stop_in_the_middle() -> None:
        while len(folder.metrics()) < 3:
            if stop.wait(0.002):
                return
        stop.set()

    watch = threading.Thread(target=stop_in_the_middle)
    watch.start()
    try:
        run_to_end(folder, endpoint=private_endpoint(), stop=stop)
    finally:
        stop.set()
        watch.join()
    assert 3 <= len(folder.metrics()) < CONFIG.iterations, "not interrupted in the middle"
    (folder.path / "about.json").write_text('{"name": "a run"}')
    return Interrupted(folder, summarize(whole)["weights_sha256"])


@pytest.fixture
def _signals() -> Iterator[None]:
    """The command takes SIGINT and SIGTERM; they are given back."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("_signals")
def test_a_run_made_before_there_were_schemas_goes_on_with_the_same_bits(
    interrupted: Interrupted, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (golden,) = GOLDEN.glob("schema-1/*")
    folder = RunFolder(tmp_path / golden.name)
    shutil.copytree(golden, folder.path)
    assert not folder.has_sealed_lines()
    before = folder.metrics()
    assert main(["train", "--resume", golden.name, "--runs-dir", str(tmp_path), "--json"]) == 0
    summary = json.loads(capfd.readouterr().out)
    assert (summary["state"], summary["iterations"]) == ("finished", CONFIG.iterations)
    assert summary["episodes_lost"] == 0
    assert (folder.metrics()[:3], folder.state().attempt) == (before, 2)
    # Bits are equal on machines of one type: where this one's are its maker's, the resumed run's are, too.
    like_its_maker = interrupted.weights_sha256 == GOLDEN_SHA256
    assert (summary["weights_sha256"] == GOLDEN_SHA256) == like_its_maker


def damage(path: Path, chance: random.Random) -> str:
    """Does something to a file; says what."""
    data = path.read_bytes()
    match chance.choice(["flip"] * 4 + ["cut"] * 2 + ["empty", "remove"]) if data else "remove":
        case "flip":
            position, bit = chance.randrange(len(data)), chance.randrange(8)
            changed = bytearray(data)
            changed[position] ^= 1 << bit
            path.write_bytes(changed)
            return f"bit {bit} of byte {position} of {len(data)} flipped"
        case "cut":
            length = chance.randrange(len(data))
            path.write_bytes(data[:length])
            return f"cut to {length} of {len(data)} bytes"
        case "empty":
            path.write_bytes(b"")
            return "emptied"
        case _:
            path.unlink()
            return "removed"


@pytest.mark.usefixtures("_signals")
@pytest.mark.parametrize("case", range(CASES))
def test_a_damaged_folder_gives_the_same_run_or_says_why_not(
    case: int,
    interrupted: Interrupted,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    copy = RunFolder(tmp_path / interrupted.folder.path.name)
    shutil.copytree(interrupted.folder.path, copy.path)
    chance = random.Random(f"case {case}")
    files = sorted(copy.path.glob(KINDS[case % len(KINDS)]))
    path = chance.choice(files)
    told = f"{path.relative_to(copy.path)}: {damage(path, chance)}"

    status = main(["train", "--resume", str(copy.run), "--runs-dir", str(tmp_path), "--json"])

    out, err = capfd.readouterr()
    logs = "".join(log.read_text(errors="replace") for log in copy.path.glob("logs/*.log"))
    assert "Traceback" not in out + err + logs, told
    if status == 0:
        summary = json.loads(out)
        assert (summary["state"], summary["weights_sha256"]) == (
            "finished", interrupted.weights_sha256
        ), told  # fmt: skip
        with capfd.disabled():
            print(f"\nSAME {told}")
        return
    assert status in (1, 2), told
    assert out == "", told
    (said,) = [line for line in err.splitlines() if line.startswith("bpn: ")]
    with capfd.disabled():
        print(f"\nREFUSED {told}: {err.splitlines()[-1]}")
    assert len(said) < 1000
