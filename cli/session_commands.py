"""The commands on recordings and sessions: `init`, `inspect`, `machine`, `frames`, `crs` and `simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

import furrowmap
from furrowmap.cli.command_options import FILE, command, files, group, option, output, overwrite
from furrowmap.cli.console import Console, error_value, put_error
from furrowmap.cli.result_tables import figures, table
from furrowmap.core.runtime.errors import InputError, printable
from furrowmap.core.runtime.settings import language_of_user

if TYPE_CHECKING:
    from furrowmap import Examined, Inspection

_SIMULATED: Final = {
    "duration_s": "recorded",
    "distance_driven_m": "driven",
    "length_m": "distance",
    "field_area_m2": "field",
    "passes": "passes",
    "worked_area_m2": "worked",
    "overlap_area_m2": "worked twice",
    "transitions": "tool raised or lowered",
    "parcels": "parcels",
}
"""Figures of a simulation that a terminal shows, and their names there; truth/figures.json has all."""


@command("Write a session file for a recording.", "furrowmap init recording.pcap.gz gnss.nmea")
@files("recordings", "RECORDING...")
@output("FILE", "Session file to write [default: session.toml beside RECORDING].", "Session file")
@option("--machine", "NAME|FILE", "Copy the sensor positions of this machine: the name of a saved one, or its profile.")
@overwrite("Replace an existing session file.")
def init(
    console: Console, recordings: tuple[Path, ...], output: Path | None, machine: str | None, *, overwrite: bool
) -> None:
    """Examine each RECORDING (LiDAR, GNSS, IMU, trajectory) and write a commented session file.

    RECORDINGs may include a table of images, the parcels of a trial and their treatments, and the boundary of the
    field. The command also looks for these in the folder of the recordings.

    It lists what the recordings do not contain, such as the mounting of the sensors. Enter these values where the file
    has comments for them.
    """
    with console.work(passing=True) as progress:
        proposal = furrowmap.propose_session(
            recordings, output, machine=machine, overwrite=overwrite, progress=progress
        )
    words = [f"Wrote {printable(str(proposal.path))}"]
    words += [f"  {printable(notice.text)}" for notice in proposal.found]
    if proposal.missing:
        words += ["Not found in the recordings; fill in what you know:"]
        words += [f"  {printable(notice.text)}" for notice in proposal.missing]
    found, missing = (
        [{"code": notice.code, "text": notice.text_in(language_of_user())} for notice in notices]
        for notices in (proposal.found, proposal.missing)
    )
    console.answer({"session": proposal.path, "found": found, "missing": missing}, "\n".join(words))


@command("Describe files: format, content, clocks, damage.", "furrowmap inspect recording.pcap.gz gnss.nmea")
@files("files", "FILE...")
def inspect(console: Console, files: tuple[Path, ...]) -> None:
    """Describe each FILE: format, sensor model, time span, clocks, GNSS fixes, damage, and overlap in time.

    Unreadable files are reported on standard error, the others are still described. The exit status is then 3.
    """
    examined: list[Examined] = []
    answers: list[dict[str, Any]] = []
    refused = False
    with console.work(passing=True) as progress:
        for path in files:
            progress(f"Reading {printable(path.name)}", 0.0)
            try:
                recording = furrowmap.inspect(path)
            except InputError as error:
                refused = True
                put_error(error)
                answers.append({"path": path, "error": error_value(error)})
            else:
                examined.append(recording)
                answers.append(_inspection_value(recording.inspection))
    matches = list(furrowmap.time_matches(examined))
    parts = [_inspection_words(recording.inspection) for recording in examined]
    parts += ["\n".join(printable(match.text.in_language(language_of_user())) for match in matches)] if matches else []
    console.answer({"files": answers, "time_matches": matches}, "\n\n".join(parts))
    if refused:
        click.get_current_context().exit(InputError.exit_status)


def _inspection_value(inspection: Inspection) -> dict[str, Any]:
    from furrowmap.core.values.clock import iso_utc

    return {
        "path": inspection.path,
        "format": inspection.format,
        "title": inspection.title,
        "facts": inspection.facts,
        "clocks": [
            {
                "clock": reading.clock,
                "first": iso_utc(reading.first_s),
                "last": iso_utc(reading.last_s),
                "first_s": reading.first_s,
                "last_s": reading.last_s,
                "note": reading.note,
            }
            for reading in inspection.clocks
        ],
        "notices": inspection.notices,
    }


def _inspection_words(inspection: Inspection) -> str:
    from furrowmap.core.values.clock import iso_utc

    rows = figures(inspection.facts)
    rows += [
        (
            f"clock {reading.clock}",
            f"{iso_utc(reading.first_s)} to {iso_utc(reading.last_s)}\n{printable(reading.note)}",
        )
        for reading in inspection.clocks
    ]
    rows += [("notice", printable(notice.text)) for notice in inspection.notices]
    title = inspection.title.in_language(language_of_user())
    return f"{printable(str(inspection.path))}: {printable(title)}\n{table(rows)}"


@group(
    "Save the positions of sensors and tool, once per machine.",
    "furrowmap machine save session.toml 'Tractor 1, tiller'",
)
def machine() -> None:
    """Profiles of machines: where antenna, scanner, IMU, camera and tool sit, for `furrowmap init --machine`."""


@command(
    "Save the machine of a session.",
    "furrowmap machine save session.toml 'Tractor 1, tiller'",
    "furrowmap machine save session.toml tractor1.toml",
    group=machine,
)
@click.argument("session", type=FILE)
@click.argument("name", metavar="NAME|FILE")
@overwrite("Replace an existing profile.")
def save(console: Console, session: Path, name: str, *, overwrite: bool) -> None:
    """Save the machine of SESSION under NAME, or as a FILE (.toml) to pass on."""
    saved = furrowmap.save_machine(session, name, overwrite=overwrite)
    console.answer({"name": saved.name, "machine": saved.path}, f"Wrote {printable(str(saved.path))}")


@command("List the saved machines.", "furrowmap machine list", name="list", group=machine)
def list_machines(console: Console) -> None:
    """List the saved machines and their files. FURROWMAP_MACHINES names another folder, such as a shared one."""
    found = furrowmap.known_machines()
    rows = [(printable(each.name), _machine_words(each)) for each in found]
    answer = {"machines": [{"name": each.name, "machine": each.path} for each in found]}
    console.answer(answer, table(rows) if rows else "No machines.")


def _machine_words(known: furrowmap.KnownMachine) -> str:
    if known.machine is None:
        return f"not readable: {printable(str(known.path))}"
    parts = [name for name in ("antenna", "lidar", "imu", "camera", "implement") if getattr(known.machine, name)]
    day = f", calibrated {known.machine.calibrated.date}" if known.machine.calibrated is not None else ""
    return f"{', '.join(parts)}{day}"


@command("Show the frames of a session as a tree.", "furrowmap frames session.toml --svg frames.svg")
@click.argument("session", type=FILE)
@option("--svg", "FILE", "Draw the frames from the side and from above.", label="Drawing")
def frames(console: Console, session: Path, svg: Path | None) -> None:
    """Show the frames of SESSION as a tree: earth, map, vehicle, and each sensor with its translation and rotation.

    Names and axes are those of REP-103 and REP-105; angles are roll, pitch, yaw of the sensor's axes in the vehicle
    frame. The recordings are not read.
    """
    tree = furrowmap.frames(session, svg)
    words = "\n".join(map(printable_line, tree.text.splitlines()))
    console.answer({**tree.plain(), "svg": svg}, words)


def printable_line(line: str) -> str:
    """A line of the tree; its indentation is kept."""
    content = line.lstrip(" │├└─")
    return line[: len(line) - len(content)] + printable(content)


@command("Show the coordinate transformations of a session.", "furrowmap crs session.toml")
@click.argument("session", type=FILE)
def crs(console: Console, session: Path) -> None:
    """Show how `furrowmap run` will transform the coordinates of SESSION, with values at the site. Writes no files.

    Frame and epoch, displacement of the positions, geoid height, easting and northing, grid convergence and scale, and
    areas on the map and on the ellipsoid.
    """
    with console.work() as progress:
        progress("reading positions", 0.0)
        site = furrowmap.site_coordinates(session)
    console.warn_all(site.transform.notices)
    console.answer(site.plain(), table((subject, printable(sentence)) for subject, sentence in site.sentences))


@command(
    "Simulate a recording with its ground truth.",
    "furrowmap simulate demo -o demo",
    "furrowmap simulate my_mount.toml -o my_mount",
)
@click.argument("scenario", type=FILE)
@output("DIR", "Output folder.", "Output folder", required=True)
@overwrite("Replace files in DIR.")
def simulate(console: Console, scenario: Path, output: Path, *, overwrite: bool) -> None:
    """Simulate the recording of a tractor or an aircraft in SCENARIO: a TOML file, "demo", "road" or "flight".

    Writes the recordings of LiDAR, GNSS and IMU, a session file, the field boundary, and the ground truth in truth/.
    """
    with console.work() as progress:
        simulated = furrowmap.simulate(scenario, output, overwrite=overwrite, progress=progress)
    session = printable(str(simulated.session))
    rows = figures({key: simulated.figures[key] for key in _SIMULATED if key in simulated.figures})
    names = [name for key, name in _SIMULATED.items() if key in simulated.figures]
    shown = [(name, value) for name, (_, value) in zip(names, rows, strict=True)]
    words = f"{table(shown)}\nWrote {session} and its files. Next: furrowmap run {session}"
    console.answer({"folder": simulated.folder, "session": simulated.session, "figures": simulated.figures}, words)
