"""`furrowmap inspect`: format and content of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import furrowmap
from furrowmap.cli.console import Console, error_value, put_error
from furrowmap.cli.options import command, files
from furrowmap.cli.tables import figures, table
from furrowmap.core.runtime.errors import InputError, printable

if TYPE_CHECKING:
    from furrowmap import Examined, Inspection


@command("Describe files: format, content, clocks, damage.", "furrowmap inspect recording.pcap.gz gnss.nmea")
@files("files", "FILE...")
def inspect(console: Console, files: tuple[Path, ...]) -> None:
    """Describe each FILE: format, sensor model, time span, clocks, GNSS fixes, damage; and how several overlap in time.

    A file that cannot be read is reported on standard error; the others are still described, and the exit status is
    3.
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
                answers.append(_value(recording.inspection))
    matches = list(furrowmap.time_matches(examined))
    parts = [_words(recording.inspection) for recording in examined]
    parts += ["\n".join(printable(match.text) for match in matches)] if matches else []
    console.answer({"files": answers, "time_matches": matches}, "\n\n".join(parts))
    if refused:
        click.get_current_context().exit(InputError.exit_status)


def _value(inspection: Inspection) -> dict[str, Any]:
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


def _words(inspection: Inspection) -> str:
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
    return f"{printable(str(inspection.path))}: {printable(inspection.title)}\n{table(rows)}"
