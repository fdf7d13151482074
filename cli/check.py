"""`furrowmap check`: a cloud or a surface against surveyed points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from furrowmap.cli.console import Console, put_error
from furrowmap.cli.options import FILE, common_options, named_crs
from furrowmap.cli.words import table
from furrowmap.core.values.errors import RefusedError, printable

if TYPE_CHECKING:
    from furrowmap.core.checking.check import Check
    from furrowmap.core.checking.positional_accuracy import Component

CLASS = click.FloatRange(0.0, min_open=True)


@click.command(
    short_help="Compare a cloud or a surface with surveyed points.",
    epilog="\b\nExample:\n  furrowmap check cloud.copc.laz points.csv --points-sigma 0.01 --require-vertical 0.05",
)
@click.argument("product", metavar="CLOUD_OR_DSM", type=FILE)
@click.argument("points", metavar="POINTS", type=FILE)
@click.option(
    "--crs",
    metavar="CRS",
    help="The CRS of the points, and of a cloud, where their files state none [default: the product's].",
)
@click.option("--points-sigma", type=CLASS, metavar="METRES", help="The survey's own standard deviation on each axis.")
@click.option(
    "--targets",
    type=click.Choice(["none", "intensity", "colour"]),
    default="none",
    show_default=True,
    help="Look for discs around the points, by this, for the horizontal error.",
)
@click.option("--diameter", type=CLASS, default=0.3, show_default=True, metavar="METRES", help="Of the discs.")
@click.option("--require-vertical", type=CLASS, metavar="METRES", help="Exit with 4 if the vertical RMSE is greater.")
@click.option(
    "--require-horizontal", type=CLASS, metavar="METRES", help="Exit with 4 if the horizontal RMSE is greater."
)
@click.option("--table", "table_file", type=FILE, metavar="FILE", help="Write the points, one a row, as a CSV.")
@click.option("--overwrite", is_flag=True, help="Replace that file.")
@common_options
def check(
    console: Console,
    product: Path,
    points: Path,
    crs: str | None,
    points_sigma: float | None,
    targets: Any,
    diameter: float,
    require_vertical: float | None,
    require_horizontal: float | None,
    table_file: Path | None,
    *,
    overwrite: bool,
) -> None:
    """Compare CLOUD_OR_DSM (LAS, LAZ, COPC or GeoTIFF) with surveyed POINTS (CSV or GeoPackage).

    The height of a cloud is that of the plane through the returns around a point, of a surface bilinear between four
    cells. RMSE after ASPRS Positional Accuracy Standards, Edition 2 (2023), with the points' own accuracy included, and
    precision within and between swaths. An RMSE that is asked for and not met, or cannot be told, sets the exit status
    4; precision beyond that class is a warning.
    """
    from furrowmap.core.checking.check import check_product
    from furrowmap.exporters.files.atomic import refuse_existing
    from furrowmap.exporters.reports.check_table import point_rows, write_check_table

    if table_file is not None:
        refuse_existing(table_file, overwrite=overwrite)
    with console.work() as progress:
        found = check_product(
            product,
            points,
            points_crs=named_crs(crs),
            targets=targets,
            diameter_m=diameter,
            sigma_m=points_sigma,
            class_m=require_vertical,
            progress=progress,
        )
    for notice in found.notices:
        console.warn(notice)
    if table_file is not None:
        write_check_table(table_file, found)
    accuracy = found.accuracy
    asked = (
        ("vertical", accuracy.vertical.rmse_m if accuracy.vertical is not None else None, require_vertical),
        ("horizontal", accuracy.horizontal_m, require_horizontal),
    )
    verdicts: dict[str, Any] = {
        name: {"rmse_m": rmse_m, "required_m": least, "met": rmse_m is not None and rmse_m <= least}
        for name, rmse_m, least in asked
        if least is not None
    }
    precision = accuracy.precision.verdicts(require_vertical) if require_vertical is not None else {}
    answer = {
        "product": product,
        "kind": found.kind,
        "crs": found.crs.name,
        "accuracy": accuracy.plain(),
        "verdicts": verdicts,
        "precision": precision,
        "points": point_rows(found),
        "warnings": found.notices,
    }
    console.answer(answer, _words(found, point_rows(found), precision))
    for name, verdict in verdicts.items():
        if not verdict["met"]:
            put_error(_unmet(name, verdict["rmse_m"], verdict["required_m"]))
    if not all(verdict["met"] for verdict in verdicts.values()):
        click.get_current_context().exit(RefusedError.exit_status)


def _unmet(name: str, rmse_m: float | None, required_m: float) -> RefusedError:
    known = f"is {rmse_m:.3f} m" if rmse_m is not None else "is not known, for no disc was found"
    return RefusedError(
        f"The {name} RMSE {known}; {required_m:g} m was asked for.",
        f"The product does not meet the class of {100 * required_m:g} cm.",
        "Look at the points' table for the largest errors, and at the run's report for what its accuracy rests on.",
        code="check-not-met",
    )


def _verdict(verdict: dict[str, Any] | None) -> str:
    """Whether a figure of internal precision stays within the class that was asked for."""
    if verdict is None:
        return ""
    return f" ({'within' if verdict['met'] else 'beyond'} the {verdict['limit_m']:.3g} m of the class)"


def _words(found: Check, rows: list[dict[str, Any]], precision: dict[str, Any]) -> str:
    accuracy = found.accuracy
    lines = [("product", f"{found.kind}, {printable(found.crs.name)}")]
    parts = (("height", accuracy.vertical), ("easting", accuracy.easting), ("northing", accuracy.northing))
    lines += [(name, _component(part)) for name, part in parts if part is not None]
    told = accuracy.plain()
    for name, key in (
        ("RMSE vertical", "rmse_vertical_m"),
        ("RMSE horizontal", "rmse_horizontal_m"),
        ("RMSE 3D", "rmse_3d_m"),
        ("within swath", "within_swath_m"),
        ("within swath, greatest", "within_swath_max_m"),
        ("between swaths", "between_swath_m"),
        ("between swaths, greatest", "between_swath_max_m"),
    ):
        if told[key] is not None:
            lines.append((name, f"{told[key]:.4f} m{_verdict(precision.get(key))}"))
    worst = sorted((row for row in rows if row["error_h_m"] is not None), key=lambda row: -abs(row["error_h_m"]))[:5]
    lines += [("largest", ", ".join(f"{printable(row['name'])} {row['error_h_m']:+.3f} m" for row in worst))]
    return table(lines)


def _component(part: Component) -> str:
    return (
        f"{part.n} points: mean {part.mean_m:+.4f} m, standard deviation {part.sigma_m:.4f} m, "
        f"RMSE {part.rmse_m:.4f} m, 95 % within {part.p95_m:.4f} m, greatest {part.greatest_m:.4f} m"
    )
