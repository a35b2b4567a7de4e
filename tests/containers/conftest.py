"""The compose file, really built and run."""

import os
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from compose_project import Project, build_images


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Not part of `make test`: an engine is needed, and minutes."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.timeout(900))
            if "BPN_CONTAINERS" not in os.environ:
                item.add_marker(pytest.mark.skip(reason="containers: run `make test-containers`"))


@pytest.fixture(scope="session")
def images() -> None:
    """The images of the sources as they are."""
    build_images()


@pytest.fixture(scope="module")
def start(
    images: None,  # noqa: ARG001 - they must be there
    free_tcp_port: Callable[[], int],
) -> Iterator[Callable[..., Project]]:
    """Starts the loop in containers, without a first run; gone afterwards with its volumes."""
    started: list[Project] = []
    with pytest.MonkeyPatch.context() as patch:

        def one(*files: str) -> Project:
            name, port = f"bpn-test-{uuid.uuid4().hex[:8]}", free_tcp_port()
            patch.setenv("BPN_PORT", str(port))
            patch.setenv("BPN_FIRST_RUN", "")
            started.append(Project(name, port, ("compose.yaml", *files)))
            started[-1].up()
            return started[-1]

        try:
            yield one
        finally:
            for project in started:
                project.down()


@pytest.fixture(scope="module")
def project(start: Callable[..., Project]) -> Project:
    """The loop as compose.yaml says."""
    return start()
