"""Errors as RFC 9457 problem details. Their `type` is stable; docs/dashboard-api.md lists them.

Nobody outside reads an exception's text: what is not expected is "internal", and the log has the rest
under the request's id.
"""

import errno
import logging
from http import HTTPStatus
from typing import Annotated, Any, Self

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from pydantic import BaseModel, Field
from sqlalchemy.exc import DataError, OperationalError
from starlette.exceptions import HTTPException

from bpn_dashboard.access.tokens import RevokedError
from bpn_dashboard.registry.errors import (
    FilterError,
    ReadOnlyError,
    RunBusyError,
    RunStateError,
    StaleError,
    UnknownRunError,
    UnknownSweepError,
)
from bpn_dashboard.registry.query_language import QueryError
from bpn_dashboard.registry.saved_views import TooManyViewsError, UnknownViewError
from bpn_shared.runs.opening import ForeignFileError
from bpn_shared.spec.config import ConfigError

log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"
_TYPE = "urn:bpn:problem:"
_MAX_ERRORS = 50
_TITLES = {
    401: "Not signed in",
    403: "Not allowed",
    404: "Not found",
    409: "Not possible now",
    412: "Changed meanwhile",
    413: "Too large",
    421: "Unknown name of this server",
    422: "Wrong values",
    428: "Not said what was seen",
    429: "Too many tries",
    500: "The server failed",
    503: "Not ready",
    507: "No room",
}
"""By status. HTTP's own phrases are for programs."""


class FieldError(BaseModel):
    """One value of the request that is wrong."""

    location: Annotated[str, Field(description="where it stands, such as body.config.alpha")]
    message: str


class Problem(BaseModel):
    """Why a request failed."""

    type: Annotated[str, Field(description="stable name, urn:bpn:problem:NAME")]
    title: str
    status: int
    detail: str
    request_id: str = ""
    errors: list[FieldError] = []

    @classmethod
    def of(cls, status: int, kind: str, detail: str) -> Self:
        """A problem whose title says in plain words what its status means."""
        title = _TITLES.get(status) or HTTPStatus(status).phrase
        return cls(type=_TYPE + kind, title=title, status=status, detail=detail)


class ApiError(Exception):
    """Ends a request with a problem."""

    def __init__(
        self, status: int, kind: str, detail: str, headers: dict[str, str] | None = None
    ) -> None:
        super().__init__(detail)
        self.problem = Problem.of(status, kind, detail)
        self.headers = headers


_FULL = (errno.ENOSPC, errno.EDQUOT)
_EXPECTED: dict[type[Exception], tuple[int, str]] = {
    UnknownRunError: (404, "unknown-run"),
    UnknownSweepError: (404, "unknown-sweep"),
    UnknownViewError: (404, "unknown-view"),
    TooManyViewsError: (409, "too-many-views"),
    StaleError: (412, "stale"),
    RunBusyError: (409, "run-busy"),
    RunStateError: (409, "run-state"),
    ReadOnlyError: (409, "read-only"),
    FilterError: (422, "filter"),
    ConfigError: (422, "configuration"),
    RevokedError: (401, "not-logged-in"),
}


def problem_response(
    problem: Problem, request_id: str, headers: dict[str, str] | None = None
) -> Response:
    """The problem as an answer."""
    body = problem.model_copy(update={"request_id": request_id}).model_dump_json()
    return Response(body, problem.status, headers, MEDIA_TYPE)


def problem_of(error: Exception) -> Problem:
    """The problem that an exception of the registry or of this API is."""
    if isinstance(error, ApiError):
        return error.problem
    if isinstance(error, OSError | OperationalError):
        return _storage_problem(error)
    status, kind = next(_EXPECTED[base] for base in type(error).__mro__ if base in _EXPECTED)
    problem = Problem.of(status, kind, printable(str(error)))
    if isinstance(error, QueryError):
        problem.errors = [FieldError(location=f"query.{error.position}", message=problem.detail)]
    return problem


def _storage_problem(error: OSError | OperationalError) -> Problem:
    """Why a file or the database could not be read or written; paths are nobody's business."""
    if isinstance(error, ForeignFileError):
        detail = "a link or another program's file stands in the run's folder where a file of its own belongs"
        return Problem.of(409, "foreign-file", detail)
    text = str(error.orig) if isinstance(error, OperationalError) else error.strerror or ""
    if getattr(error, "errno", None) in _FULL or "disk is full" in text:
        detail = "the disk is full: nothing was changed. Make room, then try again"
        return Problem.of(507, "disk-full", detail)
    if isinstance(error, OperationalError):
        detail = "the database cannot be used now; the server's log has the reason. Try again"
        return Problem.of(503, "database", detail)
    detail = f"the run's folder cannot be used ({text}): nothing was changed"
    return Problem.of(507, "storage", detail)


EXPECTED_ERRORS: tuple[type[Exception], ...] = (ApiError, OSError, OperationalError, *_EXPECTED)


def install(app: FastAPI) -> None:
    """From now on all of the application's errors are problems."""

    def request_id(request: Request) -> str:
        return str(getattr(request.state, "request_id", ""))

    async def expected(request: Request, error: Exception) -> Response:
        headers = error.headers if isinstance(error, ApiError) else None
        if isinstance(error, OSError | OperationalError):
            log.warning("request %s: %s", request_id(request), error)
        return problem_response(problem_of(error), request_id(request), headers)

    async def http(request: Request, error: HTTPException) -> Response:
        kind = HTTPStatus(error.status_code).phrase.lower().replace(" ", "-")
        problem = Problem.of(error.status_code, kind, str(error.detail))
        return problem_response(problem, request_id(request), dict(error.headers or {}))

    async def invalid(request: Request, error: RequestValidationError) -> Response:
        problem = Problem.of(422, "invalid-request", "the request has wrong values")
        problem.errors = [
            FieldError(
                location=_location(item["loc"]),
                message=printable(item["msg"]).removeprefix("Value error, "),
            )
            for item in error.errors()[:_MAX_ERRORS]
        ]
        return problem_response(problem, request_id(request))

    async def unstorable(request: Request, _error: Exception) -> Response:
        detail = (
            "the database cannot hold one of the values: a number too large, or a NUL in a text"
        )
        return problem_response(Problem.of(422, "invalid-request", detail), request_id(request))

    async def unexpected(request: Request, _error: Exception) -> Response:
        detail = "the server failed; its log has the reason under the request's id"
        return problem_response(Problem.of(500, "internal", detail), request_id(request))

    for kind in EXPECTED_ERRORS:
        app.add_exception_handler(kind, expected)
    app.add_exception_handler(HTTPException, http)  # type: ignore[arg-type] # Starlette types handlers too wide
    app.add_exception_handler(RequestValidationError, invalid)  # type: ignore[arg-type]
    app.add_exception_handler(DataError, unstorable)  # servers are stricter than SQLite
    app.add_exception_handler(OverflowError, unstorable)
    app.add_exception_handler(Exception, unexpected)


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """These statuses as problems, for an operation's documentation."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {
        status: {"description": HTTPStatus(status).phrase, "content": content}
        for status in statuses
    }


def printable(text: str) -> str:
    """The text without what JSON cannot carry."""
    return text.encode("utf-8", "replace").decode()


def _location(parts: tuple[int | str, ...]) -> str:
    return printable(".".join(map(str, parts)))[:200]
