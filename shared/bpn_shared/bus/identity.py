"""Certificates that name who has them: a machine at a site, and what runs there.

Others name a role alone, and are good for that role anywhere. What a router knows somebody by is the certificate's
common name: "edge" of a role, "edge@lab-b.pi-7" of the edges of machine pi-7 at site lab-b.
"""

from typing import NamedTuple, Self

from bpn_shared.bus.access import ROUTER, Grant, Role, grants_at
from bpn_shared.errors import InputError
from bpn_shared.site import MAIN_SITE, check_name

MACHINE_ROLES: tuple[Role, ...] = ("edge", "robot_sim")
"""What may run on a machine that joins."""


class Identity(NamedTuple):
    """Who has a certificate.

    Attributes:
        role: a role, or "router" of one that passes on what edges and robots of its site say.
    """

    role: str
    site: str
    machine: str

    @classmethod
    def of(cls, role: str, site: str, machine: str) -> Self:
        """Checked.

        Raises:
            InputError: one of them is none.
        """
        if role not in (*MACHINE_ROLES, ROUTER):
            raise InputError(
                f"role = {role!r} must be one of {', '.join((*MACHINE_ROLES, ROUTER))}"
            )
        if site == MAIN_SITE:
            raise InputError(f"site = {site!r} is that of the router itself; choose another name")
        return cls(role, check_name(site, "site"), check_name(machine, "name"))

    @classmethod
    def parse(cls, common_name: str) -> Self | None:
        """What a certificate's common name says; None: it names no machine."""
        role, at, where = common_name.partition("@")
        site, dot, machine = where.partition(".")
        if not (at and dot):
            return None
        try:
            return cls.of(role, site, machine)
        except InputError:
            return None

    @property
    def common_name(self) -> str:
        return f"{self.role}@{self.site}.{self.machine}"

    def grants(self) -> frozenset[Grant]:
        """What it may do."""
        return grants_at(self.site, [role for role in MACHINE_ROLES if self.role in (role, ROUTER)])
