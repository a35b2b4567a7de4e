"""MkDocs' hook: the repository's own pages join the site, and links to what is no page become plain text."""

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PAGES = {
    "README.md": "index.md",
    **{
        name: name for name in ("ARCHITECTURE.md", "SECURITY.md", "CONTRIBUTING.md", "CHANGELOG.md")
    },
}
"""In the repository's root -> in the site."""

_LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
_PICTURE = re.compile(r'(!\[[^\]]*\]\(|src="|srcset=")([^)"\s]+)')
_FENCED = re.compile(r"(^```.*?^```)", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages of the repository's root."""
    for name, page in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text()))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links as they lead in the site."""
    here = page.file.src_uri
    source = {site: name for name, site in PAGES.items()}.get(here, f"docs/{here}")
    return rewritten(markdown, source, here)


def rewritten(markdown: str, source: str, here: str) -> str:
    """The page with its links and pictures as the site has them; blocks of code stay as they are.

    Args:
        source: the page's place in the repository.
        here: its place in the site.
    """

    def link(found: re.Match[str]) -> str:
        target = _target(found[2], source, here)
        return found[1] if target is None else f"[{found[1]}]({target})"

    def picture(found: re.Match[str]) -> str:
        return found[1] + (_target(found[2], source, here) or found[2])

    parts = _FENCED.split(markdown)
    parts[::2] = [_LINK.sub(link, _PICTURE.sub(picture, part)) for part in parts[::2]]
    return "".join(parts)


def _target(target: str, source: str, here: str) -> str | None:
    """A link's target in the site; None if it leads to what is no page there."""
    if re.match(r"[a-z]+:|#", target):
        return target
    path, _, anchor = target.partition("#")
    name = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
    name = f"{name}/README.md" if (ROOT / name / "README.md").is_file() else name
    if name in PAGES:
        found = PAGES[name]
    elif (
        name.startswith("docs/")
        and (ROOT / name).is_file()
        and name.endswith((".md", ".png", ".gif"))
    ):
        found = name.removeprefix("docs/")
    else:
        return None
    relative = posixpath.relpath(found, posixpath.dirname(here) or ".")
    return f"{relative}#{anchor}" if anchor else relative
