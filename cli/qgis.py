"""`furrowmap qgis`: the plugin for QGIS that comes along."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.core.values.errors import UsageError, printable


@click.group(
    short_help="Put the plugin into QGIS.",
    subcommand_metavar="COMMAND ...",
    no_args_is_help=False,
    epilog="\b\nExample:\n  furrowmap qgis install",
)
def qgis() -> None:
    """The plugin for QGIS that comes along with furrowmap."""


@qgis.command(
    short_help="Install the plugin into a QGIS profile.",
    epilog="\b\nExample:\n  furrowmap qgis install\n  furrowmap qgis install --profile fieldwork",
)
@click.option("--profile", metavar="NAME", help="The profile of QGIS [default: the one that QGIS starts with].")
@click.option(
    "--plugins-folder", type=FILE, metavar="DIR", help="A folder for plugins instead, such as in QGIS_PLUGINPATH."
)
@common_options
def install(console: Console, profile: str | None, plugins_folder: Path | None) -> None:
    """Put the plugin that comes along into a QGIS profile, switched on, with this furrowmap to do its work.

    An earlier version of the plugin is replaced. QGIS sees it when it starts the next time.
    """
    from furrowmap.cli.qgis_profiles import enable_plugin, find_profiles, install_plugin

    if profile is not None and plugins_folder is not None:
        raise UsageError(
            "furrowmap qgis install: --profile and --plugins-folder exclude each other.",
            "Nothing was done.",
            "Give one of them.",
            code="usage",
        )
    if plugins_folder is not None:
        installed = [install_plugin(plugins_folder)]
    else:
        installed = []
        for found in find_profiles(profile):
            installed.append(install_plugin(found.plugins))
            enable_plugin(found.settings)
    enabled = plugins_folder is None
    words = [f"Installed: {printable(str(folder))}" for folder in installed]
    words.append("Start QGIS again." if enabled else "Switch it on in QGIS: Plugins, Manage and Install Plugins.")
    console.answer({"installed": installed, "enabled": enabled, "python": sys.executable}, "\n".join(words))
