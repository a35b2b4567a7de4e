"""The web UI's own files, through HTTP."""

import gzip
import re

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from bpn_dashboard.api import problems
from bpn_dashboard.api.app import create_app
from bpn_dashboard.api.static import ui_routes


@pytest.fixture
def ui(tmp_path) -> TestClient:
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text("<!doctype html>app")
    (tmp_path / "assets/app-1a2b.js").write_text("code")
    (tmp_path / "assets/app-1a2b.js.gz").write_bytes(gzip.compress(b"packed"))
    (tmp_path / "favicon.svg").write_text("<svg/>")
    app = FastAPI()
    problems.install(app)
    app.include_router(ui_routes(tmp_path))
    return TestClient(app)


def test_the_uis_files_are_cached_as_long_as_they_are_good(ui) -> None:
    page = ui.get("/?page=run", headers={"Accept": "text/html"})
    assert (page.text, page.headers["cache-control"]) == ("<!doctype html>app", "no-cache")
    plain = ui.get("/assets/app-1a2b.js", headers={"Accept-Encoding": "identity"})
    assert plain.text == "code"
    assert "immutable" in plain.headers["cache-control"]
    assert plain.headers["content-type"].startswith("text/javascript")
    packed = ui.get("/assets/app-1a2b.js", headers={"Accept-Encoding": "gzip"})
    assert (packed.text, packed.headers["content-encoding"]) == ("packed", "gzip")
    again = ui.get(
        "/favicon.svg", headers={"If-None-Match": ui.get("/favicon.svg").headers["etag"]}
    )
    assert again.status_code == 304


@pytest.mark.parametrize(
    ("path", "home"),
    [
        ("/nonsense", "./?page=nonsense"),
        ("/runs/some-id?tab=logs", "../?page=runs"),
        ("/runs/", "../?page=runs"),
        ("/%22%3E/a/b", "../../?page=%22%3E"),
    ],
)
def test_an_address_that_is_none_leads_to_the_page(ui, path: str, home: str) -> None:
    """Relative to itself, so that it does whatever a proxy has put before it."""
    answer = ui.get(path, headers={"Accept": "text/html"}, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (302, home)


def test_behind_a_path_all_is_found_with_and_without_it(context) -> None:
    app = TestClient(
        create_app(context, prefix="/labs/bpn"),
        base_url="http://localhost:8000",
    )
    for path in ("/", "/labs/bpn", "/labs/bpn/"):
        page = app.get(path, headers={"Accept": "text/html"})
        assert (page.status_code, '<base href="/labs/bpn/" />' in page.text) == (200, True)
        assert "base-uri 'self'" in page.headers["content-security-policy"]
        asset = re.findall(r'src="\./(assets/[^"]+)"', page.text)[0]
    for found in (f"/{asset}", f"/labs/bpn/{asset}", "/labs/bpn/healthz", "/healthz"):
        assert app.get(found).status_code == 200
    assert app.get("/labs/bpnx/healthz", follow_redirects=False).status_code == 302


@pytest.mark.parametrize(
    "path", ["/assets/gone.js", "/api", "/api/gone", "/assets/../index.html.gz"]
)
def test_what_is_not_the_uis_is_not_its_page(ui, path) -> None:
    assert ui.get(path, headers={"Accept": "*/*"}).status_code in (
        404,
        200 if ".." in path else 404,
    )
    assert ui.get("/gone.json", headers={"Accept": "application/json"}).status_code == 404


def test_a_ui_that_was_not_built_says_so(tmp_path) -> None:
    app = FastAPI()
    app.include_router(ui_routes(tmp_path / "none"))
    answer = TestClient(app).get("/")
    assert answer.status_code == 503
    assert "not built" in answer.text
