"""`furrowmap qgis`: the bundled QGIS plugin."""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path

from furrowmap.cli.console import Console
from furrowmap.cli.options import command, group, option, output
from furrowmap.core.runtime.errors import UsageError, printable


@group("Install the QGIS plugin.", "furrowmap qgis install", "furrowmap qgis zip")
def qgis() -> None:
    """The QGIS plugin that is bundled with furrowmap."""


@command(
    "Install the plugin into a QGIS profile.",
    "furrowmap qgis install",
    "furrowmap qgis install --profile fieldwork",
    group=qgis,
)
@option("--profile", "NAME", "QGIS user profile [default: the one QGIS starts with].")
@option("--plugins-folder", "DIR", "Plugins folder to use instead of a profile, such as one in QGIS_PLUGINPATH.")
def install(console: Console, profile: str | None, plugins_folder: Path | None) -> None:
    """Install and enable the bundled plugin in a QGIS user profile. The plugin will use this installation of furrowmap.

    An earlier version of the plugin is replaced. Restart QGIS to load it.
    """
    from furrowmap.workflows.share.qgis_plugin import enable_plugin, find_profiles, install_plugin

    if profile is not None and plugins_folder is not None:
        raise UsageError("usage.install")
    if plugins_folder is not None:
        installed = [install_plugin(plugins_folder)]
    else:
        installed = []
        for found in find_profiles(profile):
            installed.append(install_plugin(found.plugins))
            enable_plugin(found.settings)
    enabled = plugins_folder is None
    words = [f"Installed: {printable(str(folder))}" for folder in installed]
    words.append("Restart QGIS to load it." if enabled else "Enable it in QGIS: Plugins > Manage and Install Plugins.")
    console.answer({"installed": installed, "enabled": enabled, "python": sys.executable}, "\n".join(words))


@command("Write the plugin as a zip.", "furrowmap qgis zip", "furrowmap qgis zip -o plugin.zip", name="zip", group=qgis)
@output("FILE", "Output file [default: furrowmap-VERSION.zip].", "Output file")
def write_zip(console: Console, output: Path | None) -> None:
    """Write the bundled plugin as a zip, for 'Install from ZIP' in QGIS on any computer."""
    from furrowmap.workflows.share.qgis_plugin import write_plugin_zip

    written = output or Path(f"furrowmap-{version('furrowmap')}.zip")
    write_plugin_zip(written)
    console.answer({"zip": written}, f"Wrote {printable(str(written))}")
