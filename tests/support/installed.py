"""Distributions as an installer would leave them in a folder of packages, without an installer."""

from collections.abc import Mapping
from pathlib import Path


def install(
    site: Path, name: str, groups: Mapping[str, Mapping[str, str]], *, version: str = "1.0"
) -> None:
    """Writes the metadata of a distribution.

    Args:
        site: the folder, which is or will be on sys.path.
        groups: for each entry-point group, names and the objects that they mean (`module:object`).
    """
    folder = site / f"{name.replace('-', '_')}-{version}.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [
        line
        for group, points in groups.items()
        for line in (f"[{group}]", *(f"{point} = {value}" for point, value in points.items()), "")
    ]
    (folder / "entry_points.txt").write_text("\n".join(lines))
