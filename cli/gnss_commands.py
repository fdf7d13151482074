"""`furrowmap gnss`: evaluation of GNSS logs, and positions from raw observations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

import furrowmap
from furrowmap.cli.command_options import (
    FILE,
    Paths,
    command,
    files,
    group,
    numbers,
    option,
    output,
    overwrite,
    settings_options,
)
from furrowmap.cli.console import Console
from furrowmap.cli.result_tables import table
from furrowmap.core.runtime.errors import OptionError, UsageError, printable
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.margins import with_margin
from furrowmap.settings import EvaluationSettings, SolveSettings

if TYPE_CHECKING:
    from furrowmap import Evaluation


@group("Evaluate GNSS logs, or solve positions.", "furrowmap gnss evaluate clas.sbf --reference rtk.ubx -o accuracy")
def gnss() -> None:
    """Evaluate GNSS positions, or compute them from raw observations."""


@command(
    "Compare GNSS logs with a reference.",
    "furrowmap gnss evaluate clas.sbf madoca.ubx --reference rtk.ubx -o accuracy",
    "furrowmap gnss evaluate clas.sbf --reference rtk.ubx --antenna-offset 0.30,0,0",
    "furrowmap gnss evaluate static.pos --reference 35.339325776,139.522173128,65.712",
    group=gnss,
)
@files("test", "TEST...")
@option(
    "--reference",
    "FILE|LAT,LON,HEIGHT",
    "Another log of the same drive, a trajectory, or the position of a static antenna.",
    required=True,
)
@output(
    "DIR", "Folder for evaluation.json, evaluation.html, evaluation.gpkg, services.csv and epochs.csv.", "Output folder"
)
@option(
    "--name",
    "NAME",
    "Name of a TEST in the tables; once for each, in their order [default: its correction service or file].",
    "names",
    multiple=True,
)
@option(
    "--antenna-offset",
    "FORWARD,LEFT,UP",
    "Offset in metres from the reference antenna to the TEST antenna on the same vehicle; once, or once for each "
    "TEST [default: 0,0,0].",
    "offsets",
    multiple=True,
)
@settings_options(EvaluationSettings)
@overwrite("Replace an existing evaluation in DIR.")
def evaluate(
    console: Console,
    test: Paths,
    reference: str,
    *,
    output: Path | None,
    names: tuple[str, ...],
    offsets: tuple[str, ...],
    settings: EvaluationSettings,
    overwrite: bool,
) -> None:
    """Compare the positions in each TEST with those in the reference at the same epochs.

    The statistics are those of Nakagawa et al.: average, standard deviation and RMSE in 3D, 2D, X, Y and Z, over all
    epochs and by fix type; several services are compared in one table.
    """
    labels = _labels(test, names)
    of_each = {
        label: replace(settings, antenna_offset_m=offset)
        for label, offset in zip(labels, _offsets(offsets, len(test)), strict=True)
    }
    logs = dict(zip(labels, test, strict=True))
    with console.work(passing=True) as progress:
        found = furrowmap.evaluate_gnss(logs, reference, output, of_each, overwrite=overwrite, progress=progress)
    console.warn_all(dict.fromkeys(notice for each in found.values() for notice in each.notices))
    words = [_services(found)] if len(found) > 1 else []
    words += [_words(name if len(found) > 1 else "", each) for name, each in found.items()]
    console.answer(furrowmap.evaluation_figures(found) | {"output": output}, "\n\n".join([*words, _FOOTNOTE]))


@command(
    "Compute positions from RINEX files with RTKLIB.",
    "furrowmap gnss solve rover.obs base.obs base.nav --base-position 43.0645,141.3503,46.2",
    group=gnss,
)
@click.argument("rover", type=FILE)
@click.argument("base", type=FILE)
@files("nav", "NAV...")
@output("FILE", "File to write [default: name of ROVER with .pos].", "Positions")
@settings_options(SolveSettings)
@overwrite("Replace an existing solution.")
def solve(
    console: Console,
    rover: Path,
    base: Path,
    nav: Paths,
    *,
    output: Path | None,
    settings: SolveSettings,
    overwrite: bool,
) -> None:
    """Compute the positions of ROVER relative to BASE, with the ephemerides of NAV: RINEX files.

    This needs RTKLIB's program rnx2rtkp (Debian: rtklib). To use the result, name it in a session under [recording]
    gnss.
    """
    with console.work(passing=True) as progress:
        found = furrowmap.solve_gnss(rover, base, nav, output, settings, overwrite=overwrite, progress=progress)
    console.warn_all(found.notices)
    fixes = ", ".join(f"{label} {count}" for label, count in found.by_fix.items())
    name = printable(str(found.path))
    rows = [("epochs", f"{found.epochs} ({fixes})"), ("from", found.first), ("to", found.last)]
    answer = {
        "path": found.path,
        "epochs": found.epochs,
        "by_fix": found.by_fix,
        "first": found.first,
        "last": found.last,
    }
    console.answer(answer, f"Wrote {name}\n{table(rows)}")


def _labels(test: Sequence[Path], names: Sequence[str]) -> list[str]:
    """A name for each log, no two alike."""
    if names and (len(names) != len(test) or len(set(names)) != len(names) or not all(map(str.strip, names))):
        raise UsageError("usage.label-count", test=len(test), names=len(set(names)))
    labels: list[str] = []
    for label in names or [path.name for path in test]:
        same = sum(other == label or other.startswith(f"{label} (") for other in labels)
        labels.append(f"{label} ({same + 1})" if same else label)
    return labels


def _offsets(texts: Sequence[str], tests: int) -> list[tuple[float, float, float]]:
    if len(texts) not in (0, 1, tests):
        raise UsageError("usage.offset-count", tests=tests, texts=len(texts))
    offsets = [_offset(text) for text in texts or ("0,0,0",)]
    return offsets if len(offsets) == tests else offsets * tests


def _offset(text: str) -> tuple[float, float, float]:
    offset = numbers(text)
    if len(offset) != 3 or not all(abs(part) < 100.0 for part in offset):
        wanted = Text("FORWARD,LEFT,UP in metres")
        raise OptionError("--antenna-offset", text, wanted, "0.30,-0.12,0")
    return offset[0], offset[1], offset[2]


_FOOTNOTE: Final = (
    "Test minus reference in metres: X east, Y north, Z up; signed averages of X, Y and Z; population standard\n"
    "deviation, so that RMSE² = average² + standard deviation²; along and across (left of) the direction of travel."
)
_STATISTICS: Final = (("average", "average_m"), ("standard deviation", "standard_deviation_m"), ("RMSE", "rmse_m"))


def _services(evaluations: Mapping[str, Evaluation]) -> str:
    """All services in one table, as tables 1 to 3 of Nakagawa et al."""
    axes = ("3D", "2D", "X", "Y", "Z")
    width = max(len(printable(name)) for name in evaluations)
    lines = [f"{'':<{width}}  {'':<20}" + "".join(f"{axis + ' [m]':>10}" for axis in axes)]
    for name, found in evaluations.items():
        rows = found.tables["all"]
        for number, (title, figure) in enumerate(_STATISTICS):
            values = _columns([getattr(rows[axis], figure) for axis in axes])
            lines.append(f"{printable(name) if not number else '':<{width}}  {title:<20}{values}")
    return "\n".join(lines)


def _columns(values: Iterable[float]) -> str:
    return "".join(f"{value:>10.4f}" if isfinite(value) else f"{'–':>10}" for value in values)


def _words(name: str, found: Evaluation) -> str:
    log = found.continuity
    matched = found.matched
    rows = [
        ("test", printable(found.test) + (f" ({found.service})" if found.service else "")),
        (
            "reference",
            printable(found.reference) + (f" ({found.reference_service})" if found.reference_service else ""),
        ),
        ("compared", f"{len(matched):,} of {log.epochs:,} positions"),
        ("fix types", ", ".join(f"{kind} {share:.1%}" for kind, share in log.share_by_fix.items())),
        ("first fix", ", ".join(f"{kind} after {seconds:.1f} s" for kind, seconds in log.first_by_fix_s.items())),
        ("gaps", f"{log.gaps}, longest {log.longest_gap_s:.1f} s"),
        ("outliers", f"{int(found.outlier.sum())} ({found.outlier.mean():.1%})"),
    ]
    if log.age is not None:
        rows.append(("age of corrections", f"median {log.age.median_s:.1f} s, maximum {log.age.greatest_s:.1f} s"))
    if found.within_sigmas is not None:
        shares = ", ".join(f"{share:.1%}" for share in found.within_sigmas.values())
        rows.append(("within 1, 2, 3 reported sigmas", shares))
    if found.time_ahead_s is not None:
        rows.append(("test ahead in time", f"{with_margin(*found.time_ahead_s, ' s', sign=True)} (95 %)"))
    head = [f"{printable(name)}:"] if name else []
    return "\n\n".join([*head, table(rows), *(_table(kind, rows_of) for kind, rows_of in found.tables.items())])


def _table(kind: str, rows: Mapping[str, Any]) -> str:
    def line(title: str, values: list[float]) -> str:
        return f"  {title:<20}{_columns(values)}"

    shown = {name: row for name, row in rows.items() if row.n or name not in ("along", "across")}
    return "\n".join(
        [
            f"{kind} ({rows['2D'].n:,} epochs)",
            f"  {'':<20}" + "".join(f"{name:>10}" for name in shown),
            line("average", [row.average_m for row in shown.values()]),
            line("standard deviation", [row.standard_deviation_m for row in shown.values()]),
            line("RMSE", [row.rmse_m for row in shown.values()]),
            line("95th percentile", [row.percentiles_m[3] for row in shown.values()]),
            line("maximum", [row.greatest_m for row in shown.values()]),
        ]
    )
