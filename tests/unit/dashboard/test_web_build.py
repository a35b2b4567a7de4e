"""What the build hook made of the web UI: within its budgets, precompressed, and pointing nowhere outside."""

import gzip
import re
from pathlib import Path

import pytest

import bpn_dashboard

STATIC = Path(bpn_dashboard.__file__).parent / "static"
SCRIPTS_BYTES = 200_000
STYLES_BYTES = 20_000

PAGE_BYTES = 110_000

TEXT_FILES = sorted(
    path for path in STATIC.rglob("*") if path.suffix in (".html", ".js", ".css", ".svg")
)


def test_there_is_a_page() -> None:
    assert (STATIC / "index.html") in TEXT_FILES


@pytest.mark.parametrize(("suffix", "budget"), [(".js", SCRIPTS_BYTES), (".css", STYLES_BYTES)])
def test_all_pages_together_stay_within_the_budget(suffix: str, budget: int) -> None:
    sizes = {path.name: path.stat().st_size for path in STATIC.rglob(f"*{suffix}.gz")}
    assert sizes
    assert sum(sizes.values()) <= budget, sizes


@pytest.mark.parametrize("page", ["Runs", "Run", "Compare", "System", "Sweeps", "Trash"])
def test_what_one_page_loads_stays_within_its_budget(page: str) -> None:
    """The entry, the page, and all that these import at once."""
    wanted = re.findall(r'src="\./assets/([^"]+)"', (STATIC / "index.html").read_text())
    wanted += [path.name for path in STATIC.glob(f"assets/{page}-*.js")]
    loaded: set[str] = set()
    while wanted:
        if (name := wanted.pop()) not in loaded:
            loaded.add(name)
            text = (STATIC / "assets" / name).read_text()
            wanted += re.findall(r'(?:from|import)\s*"\./([^"]+\.js)"', text)
    assert len(loaded) > 2
    assert sum((STATIC / "assets" / f"{name}.gz").stat().st_size for name in loaded) <= PAGE_BYTES


@pytest.mark.parametrize("path", TEXT_FILES, ids=lambda path: path.name)
def test_compressed_files_hold_the_same(path: Path) -> None:
    content = path.read_bytes()
    assert gzip.decompress(path.with_name(path.name + ".gz").read_bytes()) == content
    assert path.with_name(path.name + ".br").stat().st_size > 0


def test_the_page_refers_to_its_own_files_alone() -> None:
    page = (STATIC / "index.html").read_text()
    references = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert references
    for reference in references:
        assert reference.startswith("./")
        assert (STATIC / reference).is_file()


def test_the_page_needs_no_inline_script_or_style() -> None:
    page = (STATIC / "index.html").read_text()
    assert not re.search(r"<style|\sstyle=|\son\w+=", page)
    assert all(not body for body in re.findall(r"<script[^>]*>(.*?)</script>", page, re.DOTALL))
