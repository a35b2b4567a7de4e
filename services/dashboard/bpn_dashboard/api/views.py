"""Views that people have named, for everybody who uses the dashboard."""

from typing import Annotated

from fastapi import APIRouter
from pydantic import AfterValidator, BaseModel, Field

from bpn_dashboard.api.configs import Request as Body
from bpn_dashboard.api.context import Operator, Parts, Viewer
from bpn_dashboard.api.problems import responses
from bpn_dashboard.registry.saved_views import SavedView

router = APIRouter(tags=["views"])


def _trimmed(name: str) -> str:
    if not name.strip() or not name.isprintable():
        raise ValueError("a view's name is a line of text")
    return name.strip()


class ViewChange(Body):
    """A name for what an address shows."""

    name: Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_trimmed)]
    query: Annotated[
        str,
        Field(
            max_length=8000,
            pattern=r"^page=[a-z]+(&[^#\s]*)?$",
            description="the part of the page's address behind the question mark",
        ),
    ]


class ViewShown(BaseModel):
    """A saved view."""

    id: str
    name: str
    query: str
    by: str
    saved_at_unix_s: float

    @classmethod
    def of(cls, view: SavedView) -> "ViewShown":
        """As the API shows it."""
        return cls(
            id=view.id, name=view.name, query=view.query, by=view.by, saved_at_unix_s=view.saved_at
        )


class ViewList(BaseModel):
    """By name."""

    items: list[ViewShown]


@router.get("/views", operation_id="listViews")
def list_views(_who: Viewer, parts: Parts) -> ViewList:
    """All saved views."""
    return ViewList(items=[ViewShown.of(view) for view in parts.views.all()])


@router.post("/views", operation_id="saveView", status_code=201, responses=responses(409, 422, 507))
def save_view(who: Operator, parts: Parts, body: ViewChange) -> ViewShown:
    """Saves a new view."""
    parts.runs.check_writable()
    return ViewShown.of(parts.views.save(body.name, body.query, who.name))


@router.put("/views/{view_id}", operation_id="replaceView", responses=responses(404, 409, 422, 507))
def replace_view(who: Operator, parts: Parts, view_id: str, body: ViewChange) -> ViewShown:
    """Gives a view another name or content."""
    parts.runs.check_writable()
    return ViewShown.of(parts.views.save(body.name, body.query, who.name, view_id))


@router.delete(
    "/views/{view_id}",
    operation_id="deleteView",
    status_code=204,
    responses=responses(404, 409, 507),
)
def delete_view(_who: Operator, parts: Parts, view_id: str) -> None:
    """Forgets a view; what it shows stays."""
    parts.runs.check_writable()
    parts.views.delete(view_id)
