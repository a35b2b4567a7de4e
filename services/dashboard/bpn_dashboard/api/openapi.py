"""The API's description: problems instead of the framework's errors, and which role an operation needs."""

from collections.abc import Iterator
from functools import cache
from typing import Any

from fastapi import FastAPI
from fastapi.dependencies.models import Dependant
from fastapi.openapi.utils import get_openapi
from fastapi.routing import iter_route_contexts

from bpn_dashboard.api.context import COOKIE
from bpn_dashboard.api.problems import Problem, responses

ROLE = "x-bpn-role"
"""Extension of operations: the role that they need; none: no session either."""


def describe(app: FastAPI) -> None:
    """From now on the application's document, made when it is first asked for, says what really happens."""
    app.openapi = cache(lambda: _document(app))  # type: ignore[method-assign] # the framework's own way


def _document(app: FastAPI) -> dict[str, Any]:
    document = get_openapi(
        title=app.title, version=app.version, summary=app.summary, routes=app.routes
    )
    components = document.setdefault("components", {})
    schemas = components.setdefault("schemas", {})
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    problem = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    schemas |= problem.pop("$defs") | {"Problem": problem}
    components["securitySchemes"] = {
        "bearer": {"type": "http", "scheme": "bearer"},
        "session": {
            "type": "apiKey",
            "in": "cookie",
            "name": f"{COOKIE}_INSTANCE",
            "description": "INSTANCE: eight hexadecimal digits, of each dashboard its own",
        },
    }
    for route in iter_route_contexts(app.routes):
        operations = document["paths"].get(route.path_format, {})
        for method in route.methods or ():
            if method.lower() in operations:
                _describe_operation(operations[method.lower()], route.dependant)
    return document


def _describe_operation(operation: dict[str, Any], dependant: Dependant) -> None:
    found = operation["responses"]
    problems = {422} if "422" in found else set()
    if "requestBody" in operation:
        problems |= {400, 413}
    role = next(_roles(dependant), None)
    if role is not None:
        operation[ROLE] = role
        operation["security"] = [{"bearer": []}, {"session": []}]
        problems |= {401, 403, 429}
    found |= {str(status): told for status, told in responses(*sorted(problems)).items()}


def _roles(dependant: Dependant) -> Iterator[str]:
    role = getattr(dependant.call, "role", None)
    if role is not None:
        yield role
    for inner in dependant.dependencies:
        yield from _roles(inner)
