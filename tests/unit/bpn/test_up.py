from pathlib import Path

import pytest

from bpn.cli import main
from bpn.pool import PoolSize, services_of_pool


@pytest.mark.parametrize("option", ["--learners", "--robots", "--edges"])
def test_a_wrong_number_of_workers_is_named(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["up", option, "99", "--runs-dir", str(tmp_path)]) == 2
    assert f"{option} = 99 must be 0 to 64" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_robot_and_its_edge_share_a_core_and_a_place() -> None:
    services = services_of_pool(PoolSize(robots=3, edges=2, learners=1), Path("runs"), "e", [])
    by_name = {service.name: service for service in services}
    assert list(by_name) == [
        "router", "dashboard", "learner-0", "robot-0", "robot-1", "robot-2", "edge-0", "edge-1",
    ]  # fmt: skip
    for index in range(2):
        robot, edge = by_name[f"robot-{index}"], by_name[f"edge-{index}"]
        assert robot.core == edge.core is not None
        assert robot.arguments[-1] == edge.arguments[-1]
    assert by_name["robot-0"].arguments[-1] != by_name["robot-1"].arguments[-1]
    assert [name for name, service in by_name.items() if service.essential] == [
        "router", "dashboard",
    ]  # fmt: skip


def test_a_wrong_webhook_is_refused_by_the_dashboard_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(b"s" * 32)
    told = ["--alert-webhook", "ftp://x", "--alert-secret", str(secret)]
    assert main(["up", "--port", "0", "--runs-dir", str(tmp_path / "runs"), *told]) == 2
    assert "--alert-webhook ftp://x: must be http://" in capsys.readouterr().err
