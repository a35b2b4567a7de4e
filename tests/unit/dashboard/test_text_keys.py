"""Names as people mean them: found, ordered and shown."""

import unicodedata

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bpn_dashboard.database.text_keys import folded, is_visible, order_key, search_text, visible
from bpn_dashboard.registry.store import RunStore
from bpn_shared.spec.config import RunConfig

LETTERS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
ORDERED = ["Äpfel", "apple", "Apple pie", "bulk 2", "Bulk 10", "bulk 010 b", "zebra", "Zebra 2"]


@given(LETTERS, st.sampled_from(["NFC", "NFD", "NFKC", "NFKD"]))
@example("İ", "NFC")
def test_folding_is_stable_and_blind_to_case_and_form(text: str, form: str) -> None:
    assert folded(folded(text)) == folded(text)
    assert folded(unicodedata.normalize(form, text)) == folded(text)
    assert folded(text.casefold()) == folded(text)


@given(st.lists(LETTERS, max_size=4), st.data())
def test_every_part_of_a_run_is_found_in_its_text(tags: list[str], data: st.DataObject) -> None:
    text = search_text(run_id="id-1", name="a name", notes="some notes", tags=tags)
    part = data.draw(st.sampled_from(["a name", "some notes", "id-1", *tags]))
    assert folded(part) in text


@given(st.integers(0, 10**30), st.integers(0, 10**30))
def test_numbers_in_names_are_ordered_by_size(one: int, other: int) -> None:
    assert (order_key(f"run {one}") < order_key(f"run {other}")) == (one < other)


def test_names_are_listed_as_people_order_them(store: RunStore) -> None:
    for name in reversed(ORDERED):
        store.create(RunConfig.for_task("reaching"), name=name, actor="a")
    names: list[str] = []
    after = None
    while True:
        page = store.page(sort="name", descending=False, limit=3, after=after)
        names += [row.name for row in page.rows]
        if (after := page.next_after) is None:
            break
    assert names == ORDERED


@given(LETTERS)
def test_what_is_shown_of_a_name_can_be_seen(text: str) -> None:
    shown = visible(text)
    assert all(map(is_visible, shown))
    assert shown == shown.strip()


@pytest.mark.parametrize("name", ["\u202elive", "a\u200fb", "a\x00b", "a\nb", "\u2028"])
def test_a_name_that_turns_others_around_is_refused(client, name: str) -> None:
    body = {"config": {"task": "reaching"}}
    run = client.post("/api/v1/runs", json=body | {"name": " a "}).json()
    assert run["name"] == "a"
    url = f"/api/v1/runs/{run['id']}"
    for changes in ({"name": name}, {"tags": [name]}):
        assert client.post("/api/v1/runs", json=body | changes).status_code == 422
        refused = client.patch(url, json=changes, headers={"If-Match": '"1"'})
        assert refused.status_code == 422
        assert "cannot be seen" in refused.text
    sweep = {"config": {"task": "reaching"}, "seeds": [1], "name": name}
    assert client.post("/api/v1/sweeps", json=sweep).status_code == 422


def test_a_name_of_blanks_is_none(client) -> None:
    body = {"config": {"task": "reaching"}, "name": "   "}
    assert client.post("/api/v1/runs", json=body).json()["name"] == "reaching bpn seed 0"
    assert client.post("/api/v1/runs", json=body | {"tags": [" "]}).status_code == 422
