"""Notes are Markdown that anybody with the role operator writes, and everybody reads."""

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, expect

ELSEWHERE = "https://elsewhere.example"
NOTES = f"""# Findings

**Good** with `alpha=0.95`: see [the paper]({ELSEWHERE}/paper "of 2026"), <{ELSEWHERE}/plain>,
[its sweep](?page=sweeps).

<script>window.ran = 'script'</script>
<script src="{ELSEWHERE}/script.js"></script>
<img src="{ELSEWHERE}/pixel.png" onerror="window.ran = 'onerror'">
<img src="x" onerror=window.ran='onerror'>
![picture]({ELSEWHERE}/picture.png)

[press me](javascript:window.ran='link') [or me](JaVaScRiPt&colon;window.ran='entity')
[data](data:text/html,<script>window.ran='data'</script>) [vb](vbscript:x) [file](file:///etc/passwd)
[quoted](https://a.example/"onmouseover="window.ran='attribute')
[title](https://b.example 'x" onclick="window.ran=1')

<a href="javascript:window.ran='html link'" onclick="window.ran='onclick'">html link</a>
<iframe src="{ELSEWHERE}/frame"></iframe><iframe srcdoc="<script>parent.ran='srcdoc'</script>"></iframe>
<style>@import url({ELSEWHERE}/style.css); body {{ display: none }}</style>
<p style="position: fixed; inset: 0; background: url({ELSEWHERE}/background.png)">over everything</p>
<svg onload="window.ran='svg'"><script>window.ran='svg script'</script><image href="{ELSEWHERE}/svg.png"/></svg>
<svg><animate onbegin="window.ran='animate'" attributeName="x" dur="1s"/><use href="{ELSEWHERE}/use.svg#x"/></svg>
<math><mtext><table><mglyph>
<style><img src=x onerror="window.ran='mutation'"></style></mglyph></table></mtext></math>
<form action="{ELSEWHERE}/form">
<input name="password" autofocus onfocus="window.ran='onfocus'"><button>log in</button></form>
<link rel="stylesheet" href="{ELSEWHERE}/link.css"><meta http-equiv="refresh" content="0;url={ELSEWHERE}/refresh">
<base href="{ELSEWHERE}/"><object data="{ELSEWHERE}/object"></object><embed src="{ELSEWHERE}/embed">
<video src="{ELSEWHERE}/video" autoplay></video><details open ontoggle="window.ran='ontoggle'">x</details>
<div id="main" class="skeleton" name="body">clobbers</div>

Use <run> of the day. The last line."""
ALLOWED = {
    "P", "BR", "H3", "STRONG", "EM", "CODE", "PRE", "UL", "OL", "LI", "A", "BLOCKQUOTE",
}  # fmt: skip


@pytest.fixture
def notes(page: Page, dashboard: Any, finished: str) -> Any:
    """The hostile notes of a run, as they are shown to who opens it."""
    before = dashboard.ask("GET", f"/runs/{finished}")
    dashboard.patch(finished, before["rev"], {"notes": NOTES})
    page.goto(f"{dashboard.url}?page=run&run={finished}")
    shown = page.locator(".markdown")
    expect(shown.get_by_role("heading", name="Findings", level=3)).to_be_visible()
    yield shown
    rev = dashboard.ask("GET", f"/runs/{finished}")["rev"]
    dashboard.patch(finished, rev, {"notes": before["notes"]})


def test_nothing_in_a_note_runs_or_loads(notes: Any, page: Page, dashboard: Any) -> None:
    """That nothing is asked of another machine, and no policy violated, the page's watch looks after."""
    expect(notes.get_by_text("Use <run> of the day. The last line.")).to_be_visible()
    expect(notes).to_contain_text("<script>window.ran = 'script'</script>")  # read, not run
    expect(notes.locator("strong")).to_have_text("Good")
    expect(notes.locator("code")).to_have_text("alpha=0.95")
    made = notes.evaluate(
        "note => [...note.querySelectorAll('*')].map(one => [one.tagName, one.getAttributeNames()])"
    )
    assert {tag for tag, _ in made} <= ALLOWED
    assert {name for _, names in made for name in names} <= {"href", "title", "rel", "target"}
    for link in notes.get_by_text("press me").or_(notes.get_by_text("or me")).all():
        link.click()
    notes.get_by_text("html link").hover()
    page.mouse.move(0, 0)
    assert page.evaluate("window.ran") is None
    assert page.url.startswith(dashboard.url)
    assert page.evaluate("getComputedStyle(document.body).display") != "none"
    assert page.evaluate("document.baseURI").startswith(dashboard.url)


def test_links_in_a_note_open_elsewhere_without_a_way_back(
    notes: Any, page: Page, watch: Any, open_elsewhere: Callable[[str], None]
) -> None:
    schemes = notes.locator("a[href]").evaluate_all("all => all.map(one => one.protocol)")
    assert set(schemes) <= {"http:", "https:", "mailto:"}
    for link in notes.locator("a[href]:not([href^='?'])").all():
        expect(link).to_have_attribute("rel", "noopener noreferrer")
        expect(link).to_have_attribute("target", "_blank")
    open_elsewhere(f"{ELSEWHERE}/paper")
    with page.context.expect_page() as opened:
        notes.get_by_role("link", name="the paper").click()
    other = opened.value
    other.wait_for_load_state()
    assert other.evaluate("[opener, document.referrer]") == [None, ""]
    assert watch.outside == [f"{ELSEWHERE}/paper"]  # asked for by hand
    watch.outside.clear()
    other.close()
    notes.get_by_role("link", name="its sweep").click()
    expect(page.get_by_role("heading", name="Sweeps", level=1)).to_be_visible()


@pytest.fixture
def open_elsewhere(page: Page) -> Callable[[str], None]:
    """Answers in place of another machine, which pages here cannot reach."""

    def answer(url: str) -> None:
        page.context.route(url, lambda route: route.fulfill(body="a paper"))

    return answer
