"""The checks of `make check-claims` notice what they are there for."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks import claims, links, pages
from checks.sources import SourceError, values
from checks.text import anchors, figures, numbers, section

ROOT = Path(__file__).parents[3]
PAGE = """# Page

A network of 85,000 weights answers in 7.0 us, N = 256.

| what | result |
|---|---|
| speed | 7.0 us, 9 x, of 3 seeds |

## Sizes `a` and (b)

11 KB, see [there](#page) and `30 ms`.

    42 ms in code
"""
RESULTS = {
    "p50_us": 6.97,
    "runs": [
        {"algorithm": "bpn", "seconds": 1.0},
        {"algorithm": "cvi", "seconds": 2.0},
        {"algorithm": "bpn", "seconds": 4.0},
    ],
}
TABLE = """| policy | N | return (px) |
| --- | ---: | ---: |
| BPN | 16 | -90.7 (-99.4 to -84.0) |
| BPN | 32 | -80.0 |
"""
CLAIMS = """
["page.md"]
figures = "whole tables"
from = [
  ["7.0 us", "results.json: p50_us"],
]
measured = [["9 x", "bench", "here", "today"]]
chosen = [
  ["85,000 weights", "a size"],
  ["3 seeds", "the default"],
  ["## Sizes `a` and (b)", "sizes"],
]
"""
Write = Callable[[str, str], None]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """A small repository, in which every figure is accounted for."""

    def put(name: str, text: str) -> None:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)

    for name, text in {
        "page.md": PAGE,
        "results.json": json.dumps(RESULTS),
        "results.md": TABLE,
        claims.CLAIMS: CLAIMS,
    }.items():
        put(name, text)
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    return put


def test_where_every_figure_is_accounted_for_nothing_is_said(write: Write, tmp_path: Path) -> None:
    del write
    assert list(claims.check(tmp_path)) == []
    assert list(links.check(tmp_path)) == []


@pytest.mark.parametrize(
    ("name", "old", "new", "fault"),
    [
        ("results.json", "6.97", "7.06", "'7.0 us': 7.0 is 7.06 in the results"),
        ("results.json", "p50_us", "p50_ms", "there is no 'p50_us'"),
        ("page.md", "answers in 7.0 us", "answers in 6.1 us", "page.md:3: '6.1 us' is accounted"),
        ("page.md", "N = 256.", "N = 256 in 9 s.", "page.md:3: '9 s' is accounted"),
        ("page.md", "of 3 seeds |", "of 3 seeds, 12 |", "page.md:7: '12' is accounted"),
        ("page.md", "9 x", "many x", "does not say '9 x'"),
        ("page.md", "## Sizes `a` and (b)", "## Sizes", "does not say '## Sizes `a` and (b)'"),
        (claims.CLAIMS, '"bench", "here", "today"', '"bench"', "lacks where it is from"),
        (claims.CLAIMS, '["3 seeds", "the default"]', '["3 seeds", ""]', "lacks where it is from"),
        (claims.CLAIMS, "p50_us", "runs/seconds", "has 1 numbers and its sources 3"),
        (claims.CLAIMS, "results.json", "no.json", "'no.json' is no file"),
        (claims.CLAIMS, "whole tables", "none", "no figures ="),
        (claims.CLAIMS, "chosen =", "chose =", "page.md has chose"),
    ],
)
def test_every_kind_of_fault_is_said(
    name: str, old: str, new: str, fault: str, write: Write, tmp_path: Path
) -> None:
    before = (tmp_path / name).read_text()
    assert old in before
    write(name, before.replace(old, new))
    assert any(fault in line for line in claims.check(tmp_path))


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("results.json: p50_us * 0.001", [0.00697]),
        ("results.json: runs/seconds", [1, 2, 4]),
        ("results.json: runs/algorithm=bpn/seconds/max()", [4]),
        ("results.json: runs/1/seconds", [2]),
        ("results.json: runs/seconds/len()", [3]),
        ("results.md: BPN / return (px)", [-90.7, -99.4, -84.0]),
        ("results.md: BPN / return (px) / 1", [-99.4]),
        ("results.md: BPN + 32 / return (px)", [-80]),
        ("results.md: BPN + 32 / return (px) minus results.md: BPN / return (px) / 0", [10.7]),
        ("network: 1/256/14/weights", [209_152]),
        ("network: 6/100/17/bytes", [12_128]),
    ],
)
def test_sources_lead_to_values(
    source: str, found: list[float], write: Write, tmp_path: Path
) -> None:
    del write
    assert values(source, tmp_path) == pytest.approx(found)


@pytest.mark.parametrize(
    "source",
    [
        "results.json",
        "results.json: runs",
        "results.json: runs/algorithm=ppo/seconds",
        "results.md: BPN / loss",
        "results.md: DQN / return (px)",
        "../secret.json: a",
    ],
)
def test_sources_that_lead_nowhere_are_refused(source: str, write: Write, tmp_path: Path) -> None:
    del write
    with pytest.raises(SourceError):
        values(source, tmp_path)


@given(st.floats(-1e6, 1e6), st.integers(0, 4))
def test_a_number_shows_the_value_that_it_is_rounded_from_and_no_other(
    value: float, digits: int
) -> None:
    text = f"{value:.{digits}f}"
    assert claims.shows(text, value)
    assert not claims.shows(text, value + 1.1 * 10.0**-digits)


@given(st.lists(st.integers(-(10**9), 10**9), max_size=6))
def test_numbers_are_read_with_and_without_separators(given_numbers: list[int]) -> None:
    text = " and ".join(f"{number:,}" for number in given_numbers)
    assert [int(number) for number in numbers(text)] == given_numbers


def test_figures_are_numbers_with_units_outside_of_code_and_links() -> None:
    found = [figure.text for figure in figures(PAGE)]
    assert found == ["85,000 weights", "7.0 us", "7.0 us", "9 x", "3 seeds", "11 KB"]
    assert not list(figures("an image of 84 x 84, [there](30 s.md), Python 3.11, AVX-512"))


def test_a_section_ends_at_the_next_heading_of_its_level() -> None:
    page = "# A\n\n## B\n1\n### C\n2\n## D\n3\n"
    assert [page[slice(*section(page, name) or ())] for name in ("B", "C", "D")] == [
        "## B\n1\n### C\n2\n",
        "### C\n2\n",
        "## D\n3\n",
    ]
    assert section(page, "E") is None


def test_anchors_are_those_of_github() -> None:
    page = "# `bpn`: binary network, *CVI*\n## A [link](x.md) & more\n## Twice\n## Twice\n"
    assert anchors(page) == {"bpn-binary-network-cvi", "a-link--more", "twice", "twice-1"}


@pytest.mark.parametrize(
    ("link", "fault"),
    [
        ("[a](none.md)", "is not among the files"),
        ("[a](results.md#none)", "has no heading for #none"),
        ("[a](#none)", "has no heading for #none"),
        ("![a](../../outside.png)", "leads out of the repository"),
        ('<img src="none.png">', "is not among the files"),
        ("[a](results.md)", ""),
        ("[a](docs)", ""),
        ("[`a`](#page)", ""),
        ("`[a](none.md)`", ""),
        ("[a](https://example.org/none.md)", ""),
    ],
)
def test_links_lead_to_files_and_headings(
    link: str, fault: str, write: Write, tmp_path: Path
) -> None:
    write("page.md", PAGE + f"\n{link}\n")
    faults = list(links.check(tmp_path))
    assert len(faults) == bool(fault)
    assert all(fault in line and line.startswith("page.md:15:") for line in faults)


def test_a_result_page_that_was_edited_by_hand_is_noticed(write: Write, tmp_path: Path) -> None:
    del write
    results = tmp_path / pages.RESULTS
    results.mkdir(parents=True)
    for suffix in ("json", "md"):
        name = f"tracking.{suffix}"
        (results / name).write_text((ROOT / pages.RESULTS / name).read_text())
    assert list(pages.check(tmp_path)) == []
    page = results / "tracking.md"
    page.write_text(page.read_text().replace("98.4", "99.4"))
    assert "bpn reproduce tracking --redraw" in "".join(pages.check(tmp_path))
