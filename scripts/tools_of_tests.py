"""Programs that tests compare with: prints where one is, after it was installed where it was missing.

`python scripts/tools_of_tests.py chromium|node-readers|postgis|pyqt6|rtklib`. Of programs only Debian's packages are
installed, by root; elsewhere whoever wants the tests installs them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from collections.abc import Callable
from pathlib import Path
from tempfile import gettempdir

sys.path.insert(0, str(Path(__file__).parent))
from installing import CHECKOUT, CannotInstallError, apt_install, digest, kept, locked

PYQT6 = "6.11.0"
"""Of Qt 6, as QGIS 4 has it."""


def chromium() -> str:
    """The browser that draws the pages."""
    return found_or_installed("Chromium", lambda: shutil.which("chromium"), "chromium")


def rtklib() -> str:
    """RTKLIB's rnx2rtkp, which computes positions from RINEX."""
    return found_or_installed("RTKLIB", lambda: shutil.which("rnx2rtkp"), "rtklib")


def postgis() -> str:
    """The folder with the programs of a PostgreSQL that has PostGIS.

    No server is started, and the cluster that Debian's package would make and start is not made.
    """
    settings = Path("/etc/postgresql-common/createcluster.conf")
    options = []
    if not postgis_programs() and not settings.exists() and shutil.which("apt-get") and os.access("/etc", os.W_OK):
        settings.parent.mkdir(exist_ok=True)
        settings.write_text("create_main_cluster = false\n", encoding="utf-8")
        options = ["-o", "Dpkg::Options::=--force-confold"]
    return found_or_installed("PostGIS", postgis_programs, *options, "postgresql-postgis")


def postgis_programs() -> str | None:
    """The newest folder of such programs; None without one."""
    for control in sorted(Path("/usr/share/postgresql").glob("*/extension/postgis.control"), reverse=True):
        programs = Path("/usr/lib/postgresql", control.parents[1].name, "bin")
        if (programs / "initdb").is_file():
            return str(programs)
    return None


def node_readers() -> str:
    """The folder of the readers of the web, and of read.mjs, which uses them."""
    found_or_installed("npm", lambda: shutil.which("npm"), "nodejs", "npm")
    source = CHECKOUT / "tests" / "node"
    folder = kept(f"node-readers-{digest([source / 'package-lock.json'])}")
    folder.mkdir(exist_ok=True)
    with locked(folder / "lock"):
        for name in ("package.json", "package-lock.json", "read.mjs"):
            shutil.copy(source / name, folder)
        if not (folder / "complete").exists():
            command = [shutil.which("npm"), "ci", "--omit=optional", "--ignore-scripts", "--no-audit", "--no-fund"]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise CannotInstallError(f"the readers cannot be installed: {done.stderr.strip().splitlines()[-1]}")
            (folder / "complete").touch()
    return str(folder)


def pyqt6() -> str:
    """The interpreter of an environment with PyQt6 alone, which no other test needs."""
    folder = kept(f"pyqt6-{PYQT6}")
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    folder.mkdir(exist_ok=True)
    with locked(folder / "lock"):
        if not (folder / "complete").exists():
            venv.create(folder, with_pip=True)
            command = [str(python), "-m", "pip", "install", "--quiet", f"PyQt6=={PYQT6}"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise CannotInstallError(f"PyQt6 cannot be installed: {done.stderr.strip().splitlines()[-1]}")
            (folder / "complete").touch()
    return str(python)


def found_or_installed(what: str, find: Callable[[], str | None], *arguments: str) -> str:
    """What `find` finds, before or after these packages of Debian are installed."""
    path = find()
    if path is None:
        with locked(Path(gettempdir()) / "furrowmap-apt.lock"):
            if find() is None:
                apt_install(what, *arguments)
        path = find()
    if path is None:
        raise CannotInstallError(f"{arguments[-1]} was installed, yet there is no {what}")
    return path


TOOLS = {"chromium": chromium, "node-readers": node_readers, "postgis": postgis, "pyqt6": pyqt6, "rtklib": rtklib}

if __name__ == "__main__":
    try:
        print(TOOLS[sys.argv[1]]())
    except CannotInstallError as error:
        sys.exit(f"tools_of_tests.py: {error}")
