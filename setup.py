"""Builds the page of `furrowmap share` with the package, where npm is installed; all else is in pyproject.toml."""

import subprocess
from contextlib import suppress
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithPage(build_py):
    """The package with the scripts of that page; without npm, the package without them, which the script says."""

    def run(self) -> None:
        """Build the scripts, then what setuptools builds."""
        if not self.editable_mode:
            with suppress(OSError):  # no bash: Windows
                subprocess.run([Path(__file__).parent / "scripts" / "web_bundle.sh"], check=False)  # noqa: S603 - of this checkout
        super().run()


setup(cmdclass={"build_py": BuildWithPage})
