"""What people asked for, written in the transaction that does it."""

import time
from typing import Any

from sqlalchemy.orm import Session

from bpn_dashboard.database.tables import AuditRow

OURSELVES = "bpn-dashboard"
"""Who asked, of what the dashboard does by itself."""


def record(session: Session, actor: str, action: str, subject: str, **detail: Any) -> None:
    """Writes that `actor` did `action` to the run, sweep or token of id `subject`."""
    session.add(
        AuditRow(at=time.time(), actor=actor, action=action, subject=subject, detail=detail)
    )
