"""The System page tells how long certificates are good, and warns from thirty days on."""

import os
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

from playwright.sync_api import BrowserContext, expect
from secure_router import SecureRouter

from bpn_certificates.authority import Validity
from bpn_certificates.folders import make
from bpn_shared.bus.certificates import FOLDER_VARIABLE


def test_a_certificate_near_its_end_is_told_with_its_days_and_one_that_is_good_too(
    open_context: Callable[..., BrowserContext], free_tcp_port: Callable[[], int], tmp_path: Path
) -> None:
    secured = SecureRouter(f"tls/localhost:{free_tcp_port()}", tmp_path / "certificates")
    make(secured.certificates, days=365, server_names=["localhost"])
    now = datetime.now(UTC)
    start, end = now - timedelta(days=345), now + timedelta(days=20, hours=1)
    secured.reissue("dashboard", Validity(start, end))
    folder = secured.certificates / "dashboard"
    router = subprocess.Popen(
        [
            *(sys.executable, "-m", "bpn_shared.bus.router", "--listen", secured.endpoint),
            *("--certificates", str(secured.certificates / "router")),
        ]
    )
    dashboard = subprocess.Popen(
        [
            *(sys.executable, "-m", "bpn_dashboard", "--runs-dir", str(tmp_path / "runs")),
            *("--port", "0", "--connect", secured.endpoint),
        ],
        env=os.environ | {FOLDER_VARIABLE: str(folder)},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert dashboard.stdout is not None
        link = dashboard.stdout.readline().removeprefix("bpn dashboard: ").strip()
        page = open_context().new_page()
        page.goto(link)
        page.get_by_role("link", name="System").click()
        warning = "Certificate of the dashboard ends in 20 days: renew it with bpn-certificates."
        expect(page.get_by_text(warning)).to_be_visible()
        table = page.get_by_role("region", name="Certificates")
        row = table.get_by_role("row", name="Dashboard")
        expect(row.get_by_role("cell")).to_contain_text(["near its end", "20", "", "–"])
        expect(table.get_by_role("row", name="Router").get_by_role("cell")).to_contain_text(
            ["good", "364", "", "–"]
        )
        expect(page.get_by_text("Certificate of the router")).to_have_count(0)
        page.close()  # before the server
    finally:
        for process in (dashboard, router):
            process.terminate()
            process.wait(30)
