"""Logging in and out; tokens for scripts."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from bpn_dashboard.access.roles import Role
from bpn_dashboard.access.tokens import LINK_S, SESSION_S
from bpn_dashboard.api.configs import Request as Body
from bpn_dashboard.api.context import Admin, Operator, Parts, Viewer, wrong_token
from bpn_dashboard.api.models import Name
from bpn_dashboard.api.problems import ApiError, responses
from bpn_dashboard.database.access_tables import TokenRow

router = APIRouter(tags=["access"])


class LogIn(Body):
    """The token of a link (good once), or one for scripts."""

    token: Annotated[str, Field(min_length=1, max_length=200)]


class Session(BaseModel):
    """Who is logged in."""

    name: str
    role: Role


class LinkNew(Body):
    """A link to make, for this role or a lower one than your own."""

    role: Role = "operator"


class SignInLink(BaseModel):
    """What follows `#token=` in the link."""

    token: str
    role: Role


class TokenNew(Body):
    """A token to make."""

    name: Annotated[Name, Field(min_length=1)]
    role: Role
    lifetime_s: Annotated[
        float | None, Field(ge=60, le=10 * 366 * 86_400.0, description="null: until revoked")
    ] = None


class Token(BaseModel):
    """A token, session or link, without its secret."""

    id: str
    kind: Literal["token", "session", "link"]
    name: str
    role: Role
    created_at_unix_s: float
    last_used_at_unix_s: float | None
    expires_at_unix_s: float | None
    parent_id: Annotated[
        str | None, Field(description="of the token or session that it was made from and ends with")
    ]


class TokenMade(Token):
    """A new token; its secret is shown this once."""

    token: str


class TokenList(BaseModel):
    """All that let somebody in, newest first."""

    items: list[Token]


@router.post("/session", operation_id="logIn", status_code=204, responses=responses(401, 422, 429))
def log_in(parts: Parts, request: Request, response: Response, body: LogIn) -> None:
    """Exchanges a token for a session cookie."""
    session = parts.tokens.log_in(body.token)
    if session is None:
        wrong_token(request)
        raise ApiError(
            401,
            "wrong-token",
            "the token is unknown, used up or expired; the dashboard prints a new link when it starts",
        )
    response.set_cookie(
        parts.cookie,
        session[1],
        max_age=int(SESSION_S),
        path="/",
        secure=parts.secure,
        httponly=True,
        samesite="strict",
    )


@router.get("/session", operation_id="getSession")
def get_session(who: Viewer) -> Session:
    """Who is logged in."""
    return Session(name=who.name, role=who.role)


@router.delete("/session", operation_id="logOut", status_code=204)
def log_out(who: Viewer, parts: Parts, response: Response) -> None:
    """Ends the session, and the links and sessions made from it. Tokens stay: an admin revokes them."""
    parts.tokens.revoke(who.id, ["session"], actor=who.name)
    response.delete_cookie(parts.cookie, path="/", secure=parts.secure, httponly=True)


@router.post("/links", operation_id="createLink", status_code=201, responses=responses(422))
def create_link(who: Operator, parts: Parts, body: LinkNew) -> SignInLink:
    """A token that logs in one browser once, within a day: open the dashboard with #token=TOKEN.

    It ends with your own session or token, and so does the session that it becomes.
    """
    if not who.may(body.role):
        raise ApiError(403, "role", f"a link for {body.role} needs that role; yours is {who.role}")
    _, secret = parts.tokens.issue(
        "link", who.name, body.role, lifetime_s=LINK_S, parent=who, actor=who.name
    )
    return SignInLink(token=secret, role=body.role)


@router.get("/tokens", operation_id="listTokens")
def list_tokens(_who: Admin, parts: Parts) -> TokenList:
    """Tokens, sessions and links that are good now."""
    return TokenList(items=[Token(**_shown(row)) for row in parts.tokens.list()])


@router.post("/tokens", operation_id="createToken", status_code=201, responses=responses(422))
def create_token(who: Admin, parts: Parts, body: TokenNew) -> TokenMade:
    """A token for scripts: send it as `Authorization: Bearer TOKEN`."""
    row, secret = parts.tokens.issue(
        "token", body.name, body.role, lifetime_s=body.lifetime_s, actor=who.name
    )
    return TokenMade(**_shown(row), token=secret)


@router.delete(
    "/tokens/{token_id}", operation_id="revokeToken", status_code=204, responses=responses(404)
)
def revoke_token(who: Admin, parts: Parts, token_id: str) -> None:
    """Makes a token, session or link, and all that was made from it, worthless from now on."""
    if not parts.tokens.revoke(token_id, actor=who.name):
        raise ApiError(404, "unknown-token", "there is no token of that id")


def _shown(row: TokenRow) -> dict[str, Any]:
    return {
        "id": row.id,
        "kind": row.kind,
        "name": row.name,
        "role": row.role,
        "created_at_unix_s": row.created_at,
        "last_used_at_unix_s": row.last_used_at,
        "expires_at_unix_s": row.expires_at,
        "parent_id": row.parent_id,
    }
