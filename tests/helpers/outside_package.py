"""The example package of `docs/examples/carry`, found as if it had been installed."""

import os
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
EXAMPLE = REPOSITORY / "docs" / "examples" / "carry"


def install(patch: pytest.MonkeyPatch, site: Path) -> None:
    """Puts the package and its metadata on the path; the metadata is what an installer makes of its pyproject.toml."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    folder = site / f"{project['name']}-{project['version']}.dist-info"
    folder.mkdir()
    metadata = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (folder / "METADATA").write_text(metadata)
    groups = [
        f"[{group}]\n" + "".join(f"{name} = {target}\n" for name, target in points.items())
        for group, points in project["entry-points"].items()
    ]
    (folder / "entry_points.txt").write_text("\n".join(groups))
    for path in (EXAMPLE, site):
        patch.syspath_prepend(path)
    patch.setenv("PYTHONPATH", os.pathsep.join(map(str, (REPOSITORY, EXAMPLE, site))))
