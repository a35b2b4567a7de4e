from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.dispatcher import _keep_newest


def test_a_wish_that_is_told_late_is_not_forgotten_for_an_older_row() -> None:
    running = RunRow(id="a", rev=1, desired_state="running", iteration=3)
    stopped = RunRow(id="a", rev=2, desired_state="stopped", iteration=2)
    known: dict[str, RunRow] = {}
    _keep_newest(known, [stopped])
    _keep_newest(known, [running])  # stored before, told after
    assert known == {"a": stopped}
    progress = RunRow(id="a", rev=2, desired_state="stopped", iteration=4)
    _keep_newest(known, [progress])
    assert known == {"a": progress}
