"""Prints the lowest versions that `pyproject.toml` allows, one `name==version` a line, as constraints for pip.

Only what is named there is bound: the packages that those need in turn are pip's to choose.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).resolve().parents[1] / "pyproject.toml").read_text(encoding="utf-8"))


def lowest_versions() -> dict[str, str]:
    """Name → lower bound, of every dependency and every extra but open3d, whose 400 MB no test loads.

    Raises:
        ValueError: a dependency has no lower bound.
    """
    project = PROJECT["project"]
    extras = {name: texts for name, texts in project["optional-dependencies"].items() if name != "open3d"}
    bounds = {}
    for text in [*project["dependencies"], *(text for texts in extras.values() for text in texts)]:
        match = re.match(r"([\w.-]+)(?:\[[\w,]+\])?>=([\w.]+)", text)
        if match is None:
            raise ValueError(f"{text} has no lower bound")
        bounds[match[1]] = match[2]
    return bounds


if __name__ == "__main__":
    sys.stdout.writelines(f"{name}=={version}\n" for name, version in lowest_versions().items())
