"""Three roles, each of which may do what those before it may."""

from dataclasses import dataclass
from typing import Literal, get_args

Role = Literal["viewer", "operator", "admin"]
"""viewer: see everything; operator: start, stop and annotate runs; admin: audit and tokens."""

ROLES: tuple[Role, ...] = get_args(Role)


@dataclass(frozen=True)
class Identity:
    """Who makes a request.

    Attributes:
        id: of the token or session.
        name: for the audit and the page's corner.
        parent_id: of the token or session that this one was made from; None: of none.
    """

    id: str
    name: str
    role: Role
    parent_id: str | None = None

    @property
    def owner(self) -> str:
        """Whose share of what is limited it takes: sessions made from one token share one."""
        return self.parent_id or self.id

    def may(self, role: Role) -> bool:
        """Whether this is that role or a higher one."""
        return ROLES.index(self.role) >= ROLES.index(role)
