"""Makes a virtual environment with furrowmap (editable), its extras and a dependency group.

`python scripts/setup.py [DIR [GROUP [CONSTRAINTS]]]`: by default `.venv`, `dev` and `constraints.txt`. Its Python is
the one that runs this script.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import venv
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import web_bundle
from installing import CHECKOUT, CannotInstallError, apt_install

LEFT_OUT = {"open3d"}
"""400 MB; `make test-open3d` has it."""


def main(folder: str = ".venv", group: str = "dev", constraints: str = "constraints.txt") -> None:
    """Make the environment, and the page of `furrowmap share` where npm is installed."""
    if sys.version_info < (3, 11):  # noqa: UP036 - what runs this script is not what ruff is told of
        sys.exit(f"furrowmap needs Python 3.11 or newer, not {sys.executable}; with make: make PYTHON=python3.11 ...")
    if importlib.util.find_spec("ensurepip") is None:  # Debian ships it in a package of its own
        apt_install("ensurepip", "python{}.{}-venv".format(*sys.version_info))
    import tomllib

    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = ",".join(name for name in project["optional-dependencies"] if name not in LEFT_OUT)
    python = CHECKOUT / folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    # An environment whose interpreter is gone, or whose checkout was moved, is made anew.
    whole = python.exists() and subprocess.run([python, "-m", "pip", "--version"], capture_output=True, check=False)
    if not whole or whole.returncode != 0:
        print(f"Installing furrowmap and its libraries into {folder}: about a minute.", flush=True)
        venv.create(CHECKOUT / folder, clear=True, with_pip=True, symlinks=os.name != "nt")
    install = [python, "-m", "pip", "install", "-qq"]
    subprocess.run([*install, "--constraint", "constraints.txt", "--upgrade", "pip"], cwd=CHECKOUT, check=True)
    constrained = ["--no-compile", "--constraint", constraints, "--build-constraint", "constraints.txt"]
    subprocess.run([*install, *constrained, "--editable", f".[{extras}]", "--group", group], cwd=CHECKOUT, check=True)
    try:
        web_bundle.build()
    except CannotInstallError as error:
        print(f"The page of furrowmap share is not built ({error}); everything else works.")
        print("To build it later: python scripts/web_bundle.py")


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except CannotInstallError as error:
        sys.exit(f"setup.py: {error}")
    except subprocess.CalledProcessError as error:
        sys.exit(error.returncode)
