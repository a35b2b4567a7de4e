"""Who is invited and who has joined: kept beside the authority's key, by one process at a time.

Of an invitation there is the SHA-256 of its secret. Routers are told the machines as a list in their folders
(`bpn_shared.bus.admitted`).
"""

import contextlib
import fcntl
import json
import os
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bpn_certificates.folders import AUTHORITY_FOLDER, router_folders
from bpn_certificates.token import SECRET_BYTES, digest
from bpn_shared.bus.admitted import ADMITTED, MAX_MACHINES
from bpn_shared.bus.identity import Identity
from bpn_shared.errors import InputError
from bpn_shared.runs.files import write_atomically

_FILE, _LOCK, _AUDIT = "joining.json", ".joining.lock", "audit.jsonl"
_KEPT_S = 7 * 86_400.0
"""For so long after its end an invitation is remembered, so that whoever uses it late is told why not."""
MAX_INVITATIONS = 1000
_PATIENCE_S, _AGAIN_S = 10.0, 0.02
"""How long another process may hold the book, which takes milliseconds, and how often it is asked for."""


class JoinRefusedError(Exception):
    """A machine is not admitted; the message says why, to whoever asked."""


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Invitation(_Record):
    """One use of one machine, until a time. Times are seconds since 1970."""

    id: str
    secret_sha256: str
    machine: str | None
    site: str | None
    ends_unix_s: float
    used_unix_s: float | None = None
    used_by: str = ""
    """The common name of who did."""
    key_sha256: str = ""
    """Of the public key that it was used for."""

    def is_open(self, now_unix_s: float) -> bool:
        """Whether it can still be used."""
        return self.used_unix_s is None and self.ends_unix_s >= now_unix_s


class Machine(_Record):
    """One that has joined, or has been removed since."""

    common_name: str
    joined_unix_s: float
    removed_unix_s: float | None = None

    @property
    def identity(self) -> Identity | None:
        return Identity.parse(self.common_name)


class Door(_Record):
    """Where machines are admitted: the names of that machine, the best one first, and the port."""

    hosts: list[str]
    port: int


class _Content(_Record):
    version: Literal[1] = 1
    door: Door | None = None
    invitations: Annotated[list[Invitation], Field(max_length=MAX_INVITATIONS)] = []
    machines: Annotated[list[Machine], Field(max_length=MAX_MACHINES)] = []


class Book:
    """Of the authority in a folder.

    Args:
        folder: what `bpn_certificates.folders.make` has made.
        now_unix_s: the clock by which invitations end.
    """

    def __init__(self, folder: Path, now_unix_s: Callable[[], float] = time.time) -> None:
        self._folder, self._now = folder, now_unix_s
        self._home = folder / AUTHORITY_FOLDER

    # Where

    def place_door(self, hosts: Sequence[str], port: int) -> None:
        """Notes where machines are admitted from now on, for invitations."""
        with self._changed() as content:
            content.door = Door(hosts=list(hosts), port=port)

    def door(self) -> Door | None:
        """Where machines are admitted, as noted last; None: it never was."""
        return self._read().door

    # Invitations

    def invite(self, machine: str | None, site: str | None, lifetime_s: float) -> bytes:
        """A new secret, which is good once, for that time.

        Args:
            machine: the name that it is for; None: the machine says its own.
            site: where it will be; None: the machine is a site of its own.

        Raises:
            InputError: too many are open, or the name is taken.
        """
        secret = secrets.token_bytes(SECRET_BYTES)
        with self._changed() as content:
            if machine is not None:
                self._check_free(content, machine, InputError)
            self._make_room(content)
            made = Invitation(
                id=secrets.token_hex(4),
                secret_sha256=digest(secret),
                machine=machine,
                site=site,
                ends_unix_s=self._now() + lifetime_s,
            )
            content.invitations.append(made)
        self.note("invited", invitation=made.id, machine=machine, site=site)
        return secret

    def redeem(
        self, secret: bytes, machine: str, key_sha256: str, sign: Callable[[Identity], bytes]
    ) -> tuple[Identity, bytes]:
        """Admits a machine for a secret that has not been used.

        Whoever asks again with the same key gets the same answer: the first one may have been lost.

        Args:
            machine: the name that it gives itself; used if the invitation is for any.
            sign: makes its certificate.

        Raises:
            JoinRefusedError: the secret is wrong, used, or its time is over; or the name is taken.
        """
        with self._changed() as content:
            known = {one.secret_sha256: one for one in content.invitations}
            invitation = known.get(digest(secret))
            if invitation is None:
                raise JoinRefusedError("the token is not known here, or was revoked")
            if invitation.used_unix_s is not None:
                if invitation.key_sha256 != key_sha256:
                    raise JoinRefusedError(
                        f"the token was used at {clock(invitation.used_unix_s)} by {invitation.used_by}"
                    )
                identity = Identity.parse(invitation.used_by)
                if identity is None or not self._is_admitted(content, identity):
                    raise JoinRefusedError(f"{invitation.used_by} was removed")
                return identity, sign(identity)
            if self._now() > invitation.ends_unix_s:
                raise JoinRefusedError(f"the token expired at {clock(invitation.ends_unix_s)}")
            name = invitation.machine or machine
            self._check_free(content, name, JoinRefusedError)
            identity = Identity.of("router", invitation.site or name, name)
            certificate = sign(identity)
            self._add(content, identity)
            invitation.used_unix_s, invitation.used_by = self._now(), identity.common_name
            invitation.key_sha256 = key_sha256
        self.note("joined", invitation=invitation.id, machine=identity.common_name)
        return identity, certificate

    def _make_room(self, content: _Content) -> None:
        """Forgets the oldest of those that are good for nothing any more: only others can be revoked."""
        now, over = self._now(), len(content.invitations) - MAX_INVITATIONS + 1
        past = [one for one in content.invitations if not one.is_open(now)][: max(0, over)]
        if len(past) < over:
            raise InputError(f"{MAX_INVITATIONS} invitations are open: revoke some")
        forgotten = {one.id for one in past}
        content.invitations = [one for one in content.invitations if one.id not in forgotten]

    def revoke(self, invitation: str) -> None:
        """Ends an invitation that was not used.

        Raises:
            InputError: there is none with that id.
        """
        with self._changed() as content:
            found = [one for one in content.invitations if one.id == invitation]
            if not found or found[0].used_unix_s is not None:
                raise InputError(f"there is no open invitation {invitation!r}")
            content.invitations.remove(found[0])
        self.note("revoked", invitation=invitation)

    def invitations(self) -> list[Invitation]:
        """Those that are open."""
        now = self._now()
        return [one for one in self._read().invitations if one.is_open(now)]

    # Machines

    def admit(self, identity: Identity) -> None:
        """Admits who has got a certificate in another way; who is admitted already stays."""
        with self._changed() as content:
            if self._is_admitted(content, identity):
                return
            gone = {one.common_name for one in content.machines if one.removed_unix_s is not None}
            if identity.common_name in gone:
                raise InputError(f"{identity.common_name} was removed: choose another name")
            self._add(content, identity)
        self.note("admitted", machine=identity.common_name)

    def remove(self, machine: str) -> list[str]:
        """Lets a machine do nothing any more, and tells the common names that it had.

        Its name is not given again: whoever has its certificate would be let in.

        Raises:
            InputError: none of that name has joined.
        """
        with self._changed() as content:
            found = [
                one
                for one in content.machines
                if one.removed_unix_s is None and one.identity and one.identity.machine == machine
            ]
            if not found:
                raise InputError(f"no machine {machine!r} has joined")
            for one in found:
                one.removed_unix_s = self._now()
        self.note("removed", machine=machine)
        return [one.common_name for one in found]

    def machines(self) -> list[Machine]:
        """Those that are admitted."""
        return [one for one in self._read().machines if one.removed_unix_s is None]

    def is_admitted(self, common_name: str) -> bool:
        """Whether a certificate of this name is good."""
        return any(one.common_name == common_name for one in self.machines())

    def note(self, event: str, **more: object) -> None:
        """Writes a line into the audit."""
        line = json.dumps({"time_unix_s": round(self._now(), 3), "event": event} | more)
        descriptor = os.open(
            self._home / _AUDIT, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o600
        )
        with os.fdopen(descriptor, "a", encoding="utf-8") as file:
            file.write(f"{line}\n")

    def _add(self, content: _Content, identity: Identity) -> None:
        if len(content.machines) >= MAX_MACHINES:
            raise InputError(f"{MAX_MACHINES} machines have joined: no more do")
        content.machines.append(
            Machine(common_name=identity.common_name, joined_unix_s=self._now())
        )

    @staticmethod
    def _is_admitted(content: _Content, identity: Identity) -> bool:
        name = identity.common_name
        return any(m.common_name == name and m.removed_unix_s is None for m in content.machines)

    @staticmethod
    def _check_free(content: _Content, machine: str, error: type[Exception]) -> None:
        for one in content.machines:
            if one.identity is not None and one.identity.machine == machine:
                what = "has joined already" if one.removed_unix_s is None else "was removed"
                raise error(f"a machine {machine} {what}: choose another name with --name")

    # The file

    @contextlib.contextmanager
    def _changed(self) -> Iterator[_Content]:
        """What is in the file, which has what the body leaves when that ends without an exception."""
        with (self._home / _LOCK).open("a") as lock:
            self._hold(lock)
            content = self._read()
            since = self._now() - _KEPT_S
            content.invitations = [one for one in content.invitations if one.ends_unix_s > since]
            before = content.model_dump_json()
            yield content
            if content.model_dump_json() != before:
                data = content.model_dump_json(indent=1).encode()
                write_atomically(self._home / _FILE, data, mode=0o600)
                self.tell_routers(content)

    def _hold(self, lock: IO[str]) -> None:
        """Raises:
        InputError: another process holds the lock and does not let it go.
        """
        deadline_s, pause = time.monotonic() + _PATIENCE_S, threading.Event()
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() > deadline_s:
                    raise InputError(
                        f"{lock.name} has been held by another program for {_PATIENCE_S:g} s: "
                        "end whatever `bpn invite`, `bpn machines` or `bpn up` stands still"
                    ) from None
                pause.wait(_AGAIN_S)
            else:
                return

    def tell_routers(self, content: _Content | None = None) -> None:
        """Writes the list of machines into every router's folder, where it is another one."""
        known = self._read() if content is None else content
        names = sorted(one.common_name for one in known.machines if one.removed_unix_s is None)
        data = json.dumps(names, indent=0).encode()
        for folder in router_folders(self._folder):
            path = folder / ADMITTED
            if (path.read_bytes() if path.exists() else b"[]") != data:
                write_atomically(path, data, mode=0o644)

    def _read(self) -> _Content:
        try:
            return _Content.model_validate_json((self._home / _FILE).read_bytes())
        except FileNotFoundError:
            return _Content()
        except ValidationError as error:
            raise InputError(
                f"{self._home / _FILE} is damaged: put a copy back, or remove it and let all machines join again"
            ) from error


def clock(unix_s: float) -> str:
    """A time for people."""
    return time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(unix_s))
