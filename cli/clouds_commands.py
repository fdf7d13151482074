"""The commands on point clouds of any software: `surface`, `cloud`, `colour`, `features` and `check`."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import furrowmap
from furrowmap.cli.command_options import FILE, Paths, command, files, flag, option, output, overwrite, settings_options
from furrowmap.cli.console import Console, put_error
from furrowmap.cli.result_tables import figures, file_size, surveyed, table
from furrowmap.core.runtime.errors import RefusedError, printable
from furrowmap.settings import CheckSettings, Cleaning, CleanSettings, FeatureSettings, SurfaceSettings

if TYPE_CHECKING:
    from furrowmap import Check, PairedPoints


@command(
    "Compute DSM, DTM and derived surfaces of point clouds.",
    "furrowmap surface field_a.laz field_b.laz -o surfaces --cell 0.1",
)
@files("clouds", "CLOUD...")
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(SurfaceSettings)
@overwrite("Replace existing surfaces in DIR.")
def surface(console: Console, clouds: Paths, output: Path, settings: SurfaceSettings, *, overwrite: bool) -> None:
    """Compute surfaces of CLOUDs (LAS, LAZ, COPC, PCD, PLY or E57 from any software) together on one grid.

    Writes dsm.tif (all points), dtm.tif (ground), height_above_ground.tif, hillshade.tif, slope.tif, roughness.tif,
    low_spots.tif, low_spots.gpkg and surfaces.json. Errors in file headers are reported as warnings.
    """
    with console.work() as progress:
        account = furrowmap.surface(clouds, output, settings, overwrite=overwrite, progress=progress, warn=console.warn)
    console.answer({"folder": output, **account}, surveyed(account, output))


@command(
    "Clean, classify, thin and merge point clouds into one COPC.",
    "furrowmap cloud field_a.laz field_b.laz -o field.copc.laz --outliers statistical --ground smrf",
)
@files("clouds", "CLOUD...")
@output("OUT.copc.laz", "Output file.", "Clean point cloud", required=True)
@settings_options(Cleaning, "cleaning")
@settings_options(CleanSettings)
@overwrite("Replace an existing output file.")
def cloud(
    console: Console, clouds: Paths, output: Path, cleaning: Cleaning, settings: CleanSettings, *, overwrite: bool
) -> None:
    """Merge CLOUDs (LAS, LAZ, COPC, PCD, PLY or E57 from any software) into one COPC.

    Coordinates, time, intensity, returns, class, source and colour of the points are kept. Order of the steps: box and
    classes, every N-th point, outliers, ground, voxels. Errors in file headers are reported as warnings.
    """
    settings = replace(settings, cleaning=cleaning)
    with console.work() as progress:
        account = furrowmap.clean(clouds, output, settings, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    words = table([*figures(account["figures"]), ("crs", account["crs"])])
    console.answer({"output": output, **account}, f"{words}\n{printable(str(output))}: {file_size(output)}")


@command(
    "Colour a point cloud by the images of a session.", "furrowmap colour cloud.laz session.toml -o coloured.copc.laz"
)
@click.argument("cloud", type=FILE)
@click.argument("session", type=FILE)
@output("FILE", "COPC file to write.", "Coloured point cloud", required=True)
@option("--crs", "CRS", "CRS of a point cloud whose file states none.", label="CRS of the point cloud")
@overwrite("Replace an existing file.")
def colour(console: Console, cloud: Path, session: Path, output: Path, *, crs: str | None, overwrite: bool) -> None:
    """Write CLOUD (LAS, LAZ or COPC from any software) in the colours of the images that SESSION names under [camera].

    Each point takes the colour of the best image that sees it; points that no image sees are black. The poses of the
    images come from the trajectory of SESSION; its scans are not read.
    """
    with console.work() as progress:
        account = furrowmap.colour(cloud, session, output, crs=crs, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    words = f"{table(figures(account['figures']))}\n{printable(str(output))}: {file_size(output)}"
    console.answer({"output": output, **account}, words)


@command(
    "Find ground, walls, roofs, poles, wires and plants in point clouds.", "furrowmap features yard.laz -o features"
)
@files("clouds", "CLOUD...")
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(FeatureSettings)
@overwrite("Replace existing features in DIR.")
def features(console: Console, clouds: Paths, output: Path, settings: FeatureSettings, *, overwrite: bool) -> None:
    """Classify CLOUDs (LAS, LAZ, COPC, PCD, PLY or E57 from any software) by the shape and colour around each point.

    Writes cloud.copc.laz with the classes ground, horizontal plane, vertical plane, line and vegetation; features.gpkg
    with the layers planes, lines and plants; and features.json.
    """
    with console.work() as progress:
        account = furrowmap.features(clouds, output, settings, overwrite=overwrite, progress=progress)
    console.warn_of(account)
    console.answer({"folder": output, **account}, surveyed(account, output))


@command(
    "Compare a point cloud or surface with surveyed checkpoints.",
    "furrowmap check cloud.copc.laz points.csv --points-sigma 0.01 --require-vertical 0.05",
)
@click.argument("product", metavar="CLOUD_OR_DSM", type=FILE)
@click.argument("points", metavar="POINTS", type=FILE)
@option(
    "--crs",
    "CRS",
    "CRS of points, or of a point cloud, whose file states none [default: that of the product].",
    label="CRS of the points",
)
@settings_options(CheckSettings)
@option(
    "--require-horizontal",
    "METRES",
    "Maximum horizontal RMSE (else exit status 4).",
    above=0.0,
    label="Required horizontal RMSE",
)
@flag("--pairs", "Compare points by their names, on each axis; CLOUD_OR_DSM may be a CSV of measured points.")
@option("--table", "FILE", "Write a CSV table of the errors at each point.", "table_file", label="Table of errors")
@overwrite("Replace an existing table.")
def check(
    console: Console,
    product: Path,
    points: Path,
    settings: CheckSettings,
    *,
    require_horizontal: float | None,
    pairs: bool,
    table_file: Path | None,
    **options: Any,
) -> None:
    """Compare CLOUD_OR_DSM (LAS, LAZ, COPC or GeoTIFF) with surveyed POINTS (table or vector file).

    The height of a point cloud is that of a plane fitted to the returns around a checkpoint; that of a surface is
    interpolated bilinearly. Reports the RMSE according to the ASPRS Positional Accuracy Standards, Edition 2 (2023),
    including the error of the survey, and the precision within and between swaths. The exit status is 4 if a required
    RMSE is exceeded or cannot be determined; precision outside that class is a warning.
    """
    required = (settings.class_m, require_horizontal)
    if pairs:
        with console.work() as progress:
            paired = furrowmap.check_pairs(product, points, settings, table=table_file, **options, progress=progress)
        _answer_pairs(console, product, paired, required)
        return
    with console.work() as progress:
        found = furrowmap.check(product, points, settings, table=table_file, **options, progress=progress)
    console.warn_all(found.notices)
    rows = [point.row() for point in found.points]
    vertical_m = found.accuracy.vertical.rmse_m if found.accuracy.vertical is not None else None
    verdicts = _verdicts(vertical_m, found.accuracy.horizontal_m, required)
    precision = found.accuracy.precision.verdicts(settings.class_m) if settings.class_m is not None else {}
    answer = {
        "product": product,
        "kind": found.kind,
        "crs": found.crs.name,
        "accuracy": found.accuracy.plain(),
        "verdicts": verdicts,
        "precision": precision,
        "points": rows,
        "warnings": found.notices,
    }
    console.answer(answer, _check_words(found, rows, precision))
    _exit_unless_met(verdicts)


def _answer_pairs(
    console: Console, product: Path, paired: PairedPoints, required: tuple[float | None, float | None]
) -> None:
    """Put paired points out, and judge them."""
    accuracy = paired.accuracy()
    verdicts = _verdicts(accuracy["rmse_vertical_m"], accuracy["rmse_horizontal_m"], required)
    console.warn_all(paired.notices)
    plain = {"accuracy": accuracy, "verdicts": verdicts, "warnings": paired.notices}
    console.answer({"measured": product, **paired.plain(), **plain}, _pair_words(paired))
    _exit_unless_met(verdicts)


def _verdicts(
    vertical_m: float | None, horizontal_m: float | None, required: tuple[float | None, float | None]
) -> dict[str, Any]:
    """Whether the required accuracies, vertical and horizontal, are met."""
    asked = (("vertical", vertical_m, required[0]), ("horizontal", horizontal_m, required[1]))
    return {
        name: {"rmse_m": rmse_m, "required_m": least, "met": rmse_m is not None and rmse_m <= least}
        for name, rmse_m, least in asked
        if least is not None
    }


def _exit_unless_met(verdicts: dict[str, Any]) -> None:
    """Say which required accuracy is not met, and end with exit status 4 then."""
    unmet = {name: verdict for name, verdict in verdicts.items() if not verdict["met"]}
    for name, verdict in unmet.items():
        rmse_m = verdict["rmse_m"]
        required_m = verdict["required_m"]
        put_error(
            RefusedError("check-not-met", name=name, rmse_m=rmse_m, required_m=required_m, class_cm=100 * required_m)
        )
    if unmet:
        click.get_current_context().exit(RefusedError.exit_status)


def _check_words(found: Check, rows: list[dict[str, Any]], precision: dict[str, Any]) -> str:
    accuracy = found.accuracy
    lines = [("product", f"{found.kind}, {printable(found.crs.name)}")]
    parts = (("height", accuracy.vertical), ("easting", accuracy.easting), ("northing", accuracy.northing))
    lines += [(name, _component(part)) for name, part in parts if part is not None]
    values = accuracy.plain()
    for name, key in (
        ("RMSE vertical", "rmse_vertical_m"),
        ("RMSE horizontal", "rmse_horizontal_m"),
        ("RMSE 3D", "rmse_3d_m"),
        ("within swath", "within_swath_m"),
        ("within swath, maximum", "within_swath_max_m"),
        ("between swaths", "between_swath_m"),
        ("between swaths, maximum", "between_swath_max_m"),
    ):
        if values[key] is not None:
            limit = ""
            if (verdict := precision.get(key)) is not None:
                side = "within" if verdict["met"] else "outside"
                limit = f" ({side} the class limit of {verdict['limit_m']:.3g} m)"
            lines.append((name, f"{values[key]:.4f} m{limit}"))
    worst = sorted((row for row in rows if row["error_h_m"] is not None), key=lambda row: -abs(row["error_h_m"]))[:5]
    lines += [("largest errors", ", ".join(f"{printable(row['name'])} {row['error_h_m']:+.3f} m" for row in worst))]
    return table(lines)


def _pair_words(paired: PairedPoints) -> str:
    """Differences of each point, then their mean and RMS."""
    lines = [("", f"{'X':>9} {'Y':>9} {'Z':>9}   measured less surveyed, m")]
    lines += [
        (printable(name), _axes(row)) for name, row in zip(paired.name, paired.difference_m.tolist(), strict=True)
    ]
    lines += [("mean", _axes(paired.mean_m.tolist())), ("RMS", _axes(paired.rms_m.tolist(), ""))]
    if paired.unpaired:
        lines.append(("not paired", ", ".join(map(printable, paired.unpaired))))
    return table(lines)


def _axes(values: list[float], sign: str = "+") -> str:
    """Three numbers in columns."""
    return " ".join(f"{value:>{sign}9.4f}" if math.isfinite(value) else f"{'—':>9}" for value in values)


def _component(part: Any) -> str:
    return (
        f"{part.n} points: mean {part.mean_m:+.4f} m, standard deviation {part.sigma_m:.4f} m, "
        f"RMSE {part.rmse_m:.4f} m, 95 % within {part.p95_m:.4f} m, maximum {part.greatest_m:.4f} m"
    )
