"""What pyproject.toml cannot say: the page of `furrowmap share` is built with the package, where npm is installed."""

import re
import shutil
import sys
import tomllib
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

CHECKOUT = Path(__file__).parent
sys.path.insert(0, str(CHECKOUT / "scripts"))
import web_bundle  # noqa: E402
from installing import CannotInstallError  # noqa: E402

UNBUILT = "0_without_page_of_share"
"""Build number of a wheel without that page: its file name says so, as does pip's "Created wheel"."""


def has_page(command: build_py | sdist) -> bool:
    """Build the scripts of that page where they are not current; warns where they cannot be built."""
    try:
        web_bundle.build()
    except CannotInstallError as error:
        command.warn(f"the page of furrowmap share is not in this package: {error}")
    return web_bundle.is_current()


class BuildWithPage(build_py):
    """The package with the scripts of the page; a wheel without them has this in its name."""

    def run(self) -> None:
        """Build the scripts, then what setuptools builds, into an empty folder."""
        if not self.editable_mode:
            shutil.rmtree(self.build_lib, ignore_errors=True)  # modules of an earlier state of the checkout
            if not has_page(self):
                self.get_finalized_command("bdist_wheel").build_number = UNBUILT
        super().run()


class SourcesWithPage(sdist):
    """The repository and the scripts of the page: a wheel is built from it without npm."""

    def run(self) -> None:
        """Build the scripts, then pack."""
        has_page(self)
        super().run()


def readme() -> str:
    """README.md with links that lead somewhere from a package index, where the repository's files are not."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    files = project["urls"]["Repository"].rstrip("/")
    text = (CHECKOUT / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"(!\[[^]]*\])\((?!https?:|#)([^)]+)\)", rf"\1({files}/raw/HEAD/\2)", text)
    return re.sub(r"(\[[^]]*\])\((?!https?:|#)([^)]+)\)", rf"\1({files}/blob/HEAD/\2)", text)


setup(
    cmdclass={"build_py": BuildWithPage, "sdist": SourcesWithPage},
    long_description=readme(),
    long_description_content_type="text/markdown",
)
