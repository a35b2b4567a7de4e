"""What is written from a query's tree is read back as that tree; what is no query is told with its place."""

import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bpn_dashboard.registry.errors import FilterError
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.query_language import (
    Both,
    Comparison,
    Either,
    Not,
    QueryError,
    Text,
    parse,
)
from bpn_shared.spec.config import RunConfig

texts = st.text(st.characters(exclude_characters="\0"), min_size=1, max_size=8)
fields = st.from_regex(r"[a-z_][a-z0-9_.\-/]{0,8}", fullmatch=True)
comparisons = st.builds(
    lambda field, operator, values: Comparison(
        field, operator, tuple(values[:1] if operator in ("<", "<=", ">", ">=") else values), 0, 0
    ),
    fields, st.sampled_from([":", "=", "!=", "<", "<=", ">", ">="]),
    st.lists(texts, min_size=1, max_size=3),
)  # fmt: skip
nodes = st.recursive(
    st.one_of(st.builds(Text, texts, st.just(0)), comparisons),
    lambda inner: st.one_of(
        st.builds(Not, inner),
        st.lists(inner, min_size=2, max_size=3).map(lambda parts: Both(tuple(parts))),
        st.lists(inner, min_size=2, max_size=3).map(lambda parts: Either(tuple(parts))),
    ),
    max_leaves=8,
)


def quoted(text: str) -> str:
    return '"' + re.sub(r'(["\\])', r"\\\1", text) + '"'


def written(node) -> str:
    match node:
        case Text(text):
            return quoted(text)
        case Not(inside):
            return f"not ({written(inside)})"
        case Both(parts):
            return " and ".join(f"({written(part)})" for part in parts)
        case Either(parts):
            return " OR ".join(f"({written(part)})" for part in parts)
    return f"{node.field} {node.operator} " + " , ".join(map(quoted, node.values))


def bare(node):
    """Without positions."""
    match node:
        case Text(text):
            return Text(text, 0)
        case Not(inside):
            return Not(bare(inside))
        case Both(parts):
            return Both(tuple(map(bare, parts)))
        case Either(parts):
            return Either(tuple(map(bare, parts)))
    return Comparison(node.field, node.operator, node.values, 0, 0)


@given(nodes)
def test_what_is_written_is_read_back(node) -> None:
    assert bare(parse(written(node))) == node


@given(st.text(max_size=40))
@example("((((")
@example('name:"a')
def test_any_text_is_a_query_or_says_where_it_is_none(text: str) -> None:
    wrong = None
    try:
        parse(text)
    except QueryError as error:
        wrong = error
    if wrong is not None:
        assert 0 <= wrong.position <= len(text)
        assert str(wrong).startswith(f"at character {wrong.position + 1}: ")


def test_words_are_joined_and_operators_bind_as_one_expects() -> None:
    assert bare(parse("a b or not c:d,e (f>=1)")) == Either(
        (
            Both((Text("a", 0), Text("b", 0))),
            Both(
                (
                    Not(Comparison("c", ":", ("d", "e"), 0, 0)),
                    Comparison("f", ">=", ("1",), 0, 0),
                )
            ),
        )
    )
    assert parse("  ") is None
    assert bare(parse("task:gym:CartPole-v1")) == Comparison(
        "task", ":", ("gym:CartPole-v1",), 0, 0
    )


@pytest.mark.parametrize(
    ("query", "position", "why"),
    [
        ("alpha>", 6, "a value is to follow"),
        ("(alpha>1", 8, "a ) is missing"),
        ("alpha>1)", 7, "no ( for this )"),
        ("a and", 5, "something is to follow"),
        ("or a", 0, "nothing to join"),
        ('x "abc', 2, "no second quotation mark"),
        ("alpha>1,2", 7, "takes one value"),
        ("alpa>1", 0, "did you mean alpha?"),
        ("nodes=3", 0, "hidden_units"),
        ("alpha>high", 6, "no number"),
        ("alpha>nan", 6, "no finite number"),
        ("state:broken", 6, "no state"),
        ("created>tomorrow", 8, "no day or time"),
        ("age<soon", 4, "no length of time"),
        ("name<5", 5, "compares numbers"),
        ("x and backend>2", 14, "is no number"),
        ("hidden_units=many", 13, "valid integer"),
        ("(" * 60 + "a" + ")" * 60, 50, "within each other"),
        ("a " * 900, 400, "at most 200 words"),
        ('"' + "a " * 900 + '"', 0, "at most 200 words"),
        ("alpha=" + "1," * 900 + "1", 406, "at most 200 words"),
        ("name:a\0b", 6, "no text has"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(store, query: str, position: int, why: str) -> None:
    with pytest.raises(QueryError, match=re.escape(why)) as caught:
        store.find(RunFilter(query=query))
    assert isinstance(caught.value, FilterError)
    assert caught.value.position == position


@pytest.mark.parametrize(
    "query",
    ["a " * 200, "a or " * 199 + "a", "alpha=" + "1," * 199 + "1", "not " * 49 + "a " * 199],
)
def test_the_database_takes_what_the_language_takes(store, query: str) -> None:
    assert store.find(RunFilter(query=query)) == []


@pytest.fixture
def five(store, context):
    """Five runs that differ, by name."""
    for number, (name, alpha, tags) in enumerate(
        [
            ("apple", 0.1, ["paper"]),
            ("apple zebra", 0.5, ["paper", "größe"]),
            ("zebra", 0.9, ["pape"]),
            ("Bird 100%", 0.95, ['a"b', "papers"]),
            ("gone", 0.95, []),
        ]
    ):
        config = RunConfig.for_task("reaching", alpha=alpha, hidden_units=10 * (number + 1))
        row = store.create(config, name=name, tags=tags, notes=f"note {number}", actor="a")
        folder = store.folder(row.id)
        if name != "gone":
            for iteration in range(number + 1):
                folder.append_metrics(
                    {"iteration": iteration, "return_px": -float(iteration), "weights_version": 1,
                     "length": 3.0, "loss": 1 / (iteration + 1)}
                )  # fmt: skip
        failed = {"state": "failed", "error": f"no GPU at worker {number}"} if number % 2 else {}
        store.observe({row.id: {"iteration": number, "created_at": 86400.0 * number, **failed}})
    context.ingest.poll()
    return store


FOUND = {
    "": "01234",
    "alpha>0.5": "234",
    "alpha>=0.5 alpha<0.95": "12",
    "alpha=0.1,0.9": "02",
    "alpha!=0.95": "012",
    "config.alpha=0.95": "34",
    "hidden_units<=20 or name=gone": "014",
    "apple zebra": "1",
    "apple or zebra": "012",
    '"apple zebra"': "1",
    "not apple": "234",
    "tag:paper": "01",
    "tag:größe": "1",
    r'tag:"a\"b"': "3",
    "tag:pap": "",
    "alpha>0.05 and tag:paper and state:failed": "1",
    "state:failed": "13",
    "state:failed,queued": "01234",
    "error:gpu": "13",
    'not error:"worker 3"': "0124",
    "name:APPLE": "01",
    "name:100%": "3",
    "name=apple": "0",
    "loss.last<0.6": "123",
    "metric.loss.lowest>=0.3 loss.highest=1": "012",
    "not loss.last<0.6": "04",
    "return_px.mean_5<=-0.5": "123",
    "iteration>2": "34",
    "progress<0.041": "012",
    "task:reaching algorithm:bpn": "01234",
    "task:tracking": "",
    "created:1970-01-02": "1",
    "created>1970-01-02": "234",
    "created<1970-01-02": "0",
    "created<=1970-01-02": "01",
    "age>1w": "01234",
    "age<1w": "",
    "(alpha<0.2 or alpha>0.94) not state:failed": "04",
    "device:cpu pacing:lockstep": "01234",
    "bootstrap_terminals:true": "01234",
    "sweep:none": "",
    "%": "3",
}
"""By query the runs, by number."""


def test_a_query_finds_the_runs_that_meet_it(five) -> None:
    found = {
        query: "".join(
            sorted(row.notes.removeprefix("note ") for row in five.find(RunFilter(query=query)))
        )
        for query in FOUND
    }
    assert found == FOUND


def test_a_query_is_an_error_with_its_place_for_clients(client) -> None:
    answer = client.get("/api/v1/runs", params={"query": "alpha>0.5 and tagg:x"})
    assert answer.status_code == 422
    assert answer.json()["type"] == "urn:bpn:problem:filter"
    assert answer.json()["detail"].startswith(
        "at character 15: there is no field tagg; did you mean tag?"
    )
    series = {"filter": {"query": "alpha>"}, "metrics": ["loss"]}
    assert client.post("/api/v1/series/query", json=series).status_code == 422
