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
    """

    id: str
    name: str
    role: Role

    def may(self, role: Role) -> bool:
        """Whether this is that role or a higher one."""
        return ROLES.index(self.role) >= ROLES.index(role)
