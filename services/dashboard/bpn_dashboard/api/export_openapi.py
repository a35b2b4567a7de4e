"""`python -m bpn_dashboard.api.export_openapi`: the API's description, for the web UI's types."""

import json
import sys
import tempfile
from pathlib import Path

from bpn_dashboard.api.app import create_app
from bpn_dashboard.api.context import Context
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series.ingest import Ingest
from bpn_shared.counters import Counters


def openapi_text() -> str:
    """The document as indented JSON."""
    with tempfile.TemporaryDirectory() as folder:
        runs_dir, counters = Path(folder), Counters()
        database = Database(sqlite_url(runs_dir / "index.sqlite"))
        context = Context(
            database, RunStore(database, runs_dir), Ingest(runs_dir, database, counters), counters
        )
        document = create_app(context).api.openapi()
        database.close()
    return json.dumps(document, indent=1) + "\n"


if __name__ == "__main__":
    sys.stdout.write(openapi_text())
