"""What is seen of runs while the database takes nothing."""

from sqlalchemy.exc import OperationalError

from bpn_shared.spec.config import RunConfig


def test_it_is_shown_and_told_at_once_and_written_later(store, monkeypatch, caplog) -> None:
    row = store.create(RunConfig.for_task("reaching"), actor="test")
    monkeypatch.setattr(store._database, "writing", full)
    told = []
    store.audience.subscribe(told.extend)
    for reason in ("room on the disk", "more room on the disk"):
        (seen,) = store.observe({row.id: {"waiting_reason": reason}})
        assert seen.waiting_reason == store.get(row.id).waiting_reason == reason
        assert [found.waiting_reason for found in store.find()] == [reason]
        assert [found.waiting_reason for found in store.page().rows] == [reason]
    assert [changed.waiting_reason for changed in told] == [
        "room on the disk",
        "more room on the disk",
    ]
    assert len([line for line in caplog.messages if "disk is full" in line]) == 1
    monkeypatch.undo()
    store.adopt()
    with store._database.reading() as session:
        assert session.get(type(row), row.id).waiting_reason == "more room on the disk"
    store.observe({row.id: {"waiting_reason": ""}})
    assert store.get(row.id).waiting_reason == ""


def full():
    raise OperationalError("UPDATE runs", {}, Exception("database or disk is full"))
