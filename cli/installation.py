"""The commands on furrowmap itself: `explain`, `warm-up`, `notebooks` and `qgis`."""

import re
import sys
from difflib import get_close_matches
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

import click

from furrowmap.cli.command_options import command, group, option, output
from furrowmap.cli.console import Console
from furrowmap.core.runtime.errors import UsageError, printable
from furrowmap.core.runtime.languages.expansions import expansions
from furrowmap.core.runtime.languages.messages import ERROR_PARTS
from furrowmap.core.runtime.languages.texts import ENGLISH, templates
from furrowmap.core.runtime.settings import language_of_user


@command("Explain the code of an error or a warning.", "furrowmap explain clock-offset")
@click.argument("code")
def explain(console: Console, code: str) -> None:
    """Print the messages that have CODE, and what to do about them. … stands for values such as file names."""
    keys = [key for key in templates(ENGLISH) if key.partition(".")[0] == code]
    if not keys:
        codes = sorted({key.partition(".")[0] for key in templates(ENGLISH)})
        raise UsageError("no-such-code", code=code, near=" or ".join(get_close_matches(code, codes, 3, 0.5)))
    messages = [_messages(key, language_of_user()) for key in keys]
    console.answer({"code": code, "messages": messages}, "\n\n".join("\n".join(found.values()) for found in messages))


def _messages(key: str, language: str) -> dict[str, str]:
    """The parts of the message of a key, with … for its values; of choices, the first."""
    ours = templates(language)[key]
    english = templates(ENGLISH)[key]
    found = {part: next(expansions(english[part], ours[part])) for part in (*ERROR_PARTS, "text") if part in ours}
    return {
        part: source if language == ENGLISH else re.sub(r"\{\d+\}", "…", other)
        for part, (source, other) in found.items()
    }


@command("Compile the kernels of all commands in advance.", "furrowmap warm-up run", name="warm-up")
@click.argument("commands", nargs=-1, metavar="[COMMAND]...")
def warm_up(console: Console, commands: tuple[str, ...]) -> None:
    """Compile the kernels of COMMANDs, or of all commands, and keep them in the user's cache.

    Otherwise the first run of each command compiles its own, which takes up to a minute.
    """
    from furrowmap.warm_up import warm_up as compile_kernels

    start = perf_counter()
    with console.work() as progress:
        compiled = compile_kernels(commands, progress)
    seconds = perf_counter() - start
    words = f"Compiled {compiled} functions in {seconds:.0f} s." if compiled else "All kernels were compiled already."
    console.answer({"compiled": compiled, "seconds": round(seconds, 1)}, words)


@command("Write the example notebooks.", "furrowmap notebooks examples")
@click.argument("folder", metavar="DIR", type=click.Path(file_okay=False, path_type=Path))
def notebooks(console: Console, folder: Path) -> None:
    """Write the example notebooks to DIR. They run on simulated recordings and need the extra "notebooks"."""
    from furrowmap.workflows.share.qgis_plugin import write_notebooks

    written = write_notebooks(folder)
    console.answer({"notebooks": written}, "\n".join(f"Wrote {printable(str(path))}" for path in written))


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
        raise UsageError("usage.both", one="--profile", other="--plugins-folder")
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
