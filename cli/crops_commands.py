"""The commands on crops and trials: `plots`, `parcels`, `growth`, `canopy` and `response`."""

from pathlib import Path
from typing import Any, Final

import click

import furrowmap
from furrowmap.cli.command_options import (
    FILE,
    Paths,
    command,
    files,
    numbers,
    option,
    output,
    overwrite,
    settings_options,
)
from furrowmap.cli.console import Console
from furrowmap.cli.result_tables import aligned, parcel_table, surveyed, table, written
from furrowmap.core.runtime.errors import OptionError, printable
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.margins import with_margin
from furrowmap.core.values.plot_grid import PlotGrid
from furrowmap.settings import CanopySettings, GrowthSettings, ParcelSettings, ResponseSettings


@command(
    "Lay out the plots of a trial as a grid.",
    "furrowmap plots -o plots.gpkg --crs EPSG:25832 --corner 651010.2,6132601.5 \\\n"
    "  --azimuth 86 --rows 5 --columns 4 --length 10 --width 2.5 --alley 1 --path 0.5 --blocks columns",
)
@output("FILE", "Plots, as .gpkg or .geojson.", "Plots", required=True)
@option("--crs", "CRS", "Projected CRS of the plots, such as EPSG:25832.", required=True, label="CRS of the output")
@option(
    "--corner",
    "X,Y",
    "Outer corner of the first plot, where the base line begins.",
    required=True,
    label="First corner",
)
@option("--corner-crs", "CRS", "CRS of --corner, if it differs.")
@option(
    "--end",
    "X,Y",
    "Other end of the base line: the outer corner of the first row's last plot.",
    label="End of the first row",
)
@option("--end-crs", "CRS", "CRS of --end, if it differs.")
@option("--azimuth", "DEGREES", "Direction of the base line, clockwise from north; instead of --end.")
@settings_options(PlotGrid, "grid")
@overwrite("Replace an existing FILE.")
def plots(
    console: Console,
    output: Path,
    crs: str,
    corner: str,
    corner_crs: str | None,
    end: str | None,
    end_crs: str | None,
    azimuth: float | None,
    grid: PlotGrid,
    *,
    overwrite: bool,
) -> None:
    """Lay out the plots of a trial as a grid of rectangles with identifiers and blocks.

    The base line begins at --corner and runs along the first row of plots. Columns are counted along it, rows away from
    it.
    """
    found = furrowmap.plots(
        grid,
        output,
        crs,
        _place("--corner", corner, corner_crs),
        end=_place("--end", end, end_crs) if end is not None else None,
        azimuth_deg=azimuth,
        overwrite=overwrite,
    )
    console.warn_all(found.warnings)
    blocks = len({each.block for each in found.parcels} - {None})
    answer = {
        "output": output,
        "crs": found.crs,
        "plots": len(found.parcels),
        "blocks": blocks,
        "first": found.parcels[0].id,
        "last": found.parcels[-1].id,
        "warnings": found.warnings,
    }
    words = f"{len(found.parcels)} plots, {found.parcels[0].id} to {found.parcels[-1].id}"
    console.answer(answer, f"{words}{f', in {blocks} blocks' if blocks else ''}: {printable(str(output))}")


def _place(option: str, text: str, crs: str | None) -> Any:
    place = numbers(text)
    if len(place) != 2:
        wanted = Text("easting,northing or longitude,latitude")
        raise OptionError(option, text, wanted, "651010.2,6132601.5")
    return furrowmap.Place(place[0], place[1], crs)


PARCEL_COLUMNS: Final = ("mean_height_m", "height_sigma_m", "volume_m3", "p95_m", "cover", "points_m2")


@command(
    "Measure height and volume of crops by parcel.",
    "furrowmap parcels flight.copc.laz parcels.geojson -o crops --net-inset 1.0,0.11",
)
@files("clouds", "CLOUD...")
@click.argument("parcels_file", metavar="PARCELS", type=FILE)
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(ParcelSettings)
@overwrite("Replace existing products in DIR.")
def parcels(
    console: Console, clouds: Paths, parcels_file: Path, output: Path, settings: ParcelSettings, *, overwrite: bool
) -> None:
    """Measure height and volume of the crop on each parcel of PARCELS from CLOUDs (LAS, LAZ, COPC, PCD, PLY or E57).

    PARCELS is a GeoPackage, Shapefile (also zipped), GeoJSON, FlatGeobuf, KML, or a CSV of corners, with the gross
    parcels. Writes parcels.gpkg, parcels.csv, parcels.xlsx (with the extra `trials`), crop_height.tif and parcels.json.
    """
    with console.work() as progress:
        account = furrowmap.parcels(
            clouds, parcels_file, output, settings, overwrite=overwrite, progress=progress, warn=console.warn
        )
    shown = parcel_table(account["parcels"], PARCEL_COLUMNS, "parcels.csv")
    console.answer({"folder": output, **account}, f"{shown}\n{written(account, output)}")


GROWTH_COLUMNS: Final = ("growth_m", "growth_sigma_m", "rate_m_day", "rate_sigma_m_day")


@command(
    "Measure growth of crops by parcel between flights.",
    "furrowmap growth may13.laz may23.laz parcels.geojson -o growth --net-inset 1.0,0.11",
)
@files("clouds", "CLOUD...")
@click.argument("parcels_file", metavar="PARCELS", type=FILE)
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(GrowthSettings)
@overwrite("Replace existing products in DIR.")
def growth(
    console: Console, clouds: Paths, parcels_file: Path, output: Path, settings: GrowthSettings, *, overwrite: bool
) -> None:
    """Measure how much the crop on each parcel of PARCELS grew between CLOUDs (LAS, LAZ or COPC) of several days.

    The command aligns the flights in height on the bare soil that all of them contain. Writes growth.gpkg (a layer
    coloured by growth), growth.csv, growth.xlsx and growth.json.
    """
    with console.work() as progress:
        account = furrowmap.growth(
            clouds, parcels_file, output, settings, overwrite=overwrite, progress=progress, warn=console.warn
        )
    days = table((each["day"], _alignment(each)) for each in account["flights"])
    shown = parcel_table(account["parcels"], GROWTH_COLUMNS, "growth.csv")
    console.answer({"folder": output, **account}, f"{days}\n{shown}\n{written(account, output)}")


def _alignment(flight: dict[str, Any]) -> str:
    """How a flight was aligned."""
    found = flight["alignment"]
    if found is None:
        return "reference"
    tilt = f", tilt {found['tilt_east']:+.1e} east, {found['tilt_north']:+.1e} north" if found["tilted"] else ""
    return f"soil {with_margin(found['offset_m'], found['offset_sigma_m'], ' mm', 1000.0, sign=True)} (95 %){tilt}"


@command(
    "Describe stands by cell or polygon: heights, gaps, profile.", "furrowmap canopy orchard.laz -o canopy --cell 5"
)
@files("clouds", "CLOUD...")
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(CanopySettings)
@overwrite("Replace existing products in DIR.")
def canopy(console: Console, clouds: Paths, output: Path, settings: CanopySettings, *, overwrite: bool) -> None:
    """Describe trees, orchards and other stands in CLOUDs (LAS, LAZ or COPC) by cell or polygon.

    Writes canopy_height.tif (the highest return of each pixel above the ground), canopy.gpkg and canopy.csv (height
    percentiles, gap fraction and more of each area), canopy_profile.csv (share of returns by height) and canopy.json.
    """
    with console.work() as progress:
        account = furrowmap.canopy(clouds, output, settings, overwrite=overwrite, progress=progress, warn=console.warn)
    console.answer({"folder": output, **account}, surveyed(account, output))


@command(
    "Analyse the response of a trial to its treatments.",
    "furrowmap response result/parcels.csv --treatments treatments.csv -o trial",
    "furrowmap response yields.csv --measure yield_t_ha --dose-price 0.6 --measure-price 110 -o trial",
)
@files("tables", "TABLE...")
@output("DIR", "Output folder.", "Output folder", required=True)
@option("--treatments", "FILE", "CSV or spreadsheet with what each parcel or treatment received.")
@settings_options(ResponseSettings)
@overwrite("Replace an earlier result in DIR.")
def response(
    console: Console,
    tables: Paths,
    output: Path,
    treatments: Path | None,
    settings: ResponseSettings,
    *,
    overwrite: bool,
) -> None:
    """Analyse figures of parcels by treatment. TABLE is the parcels.csv of a run, or any CSV or spreadsheet like it.

    Writes response.json, the table of parcels (trial.csv, trial.xlsx) and charts (SVG). They show the response to the
    dose by six shapes, the dose that pays and the one beyond which nothing is gained with their 95 % intervals,
    residuals, the analysis of variance, means by treatment and block, and, with several tables, growth.
    """
    account = furrowmap.response(tables, treatments, output, settings, overwrite=overwrite)
    console.warn_of(account)
    console.answer({"folder": output, **account}, _response_words(account, output))


def _response_words(account: dict[str, Any], output: Path) -> str:
    lines = []
    for flight in account["flights"]:
        lines += [f"{flight['parcels']} parcels{', ' + flight['day'] if flight['day'] else ''}"]
        lines += [f"  {printable(sentence)}" for sentence in flight["sentences"]]
        shapes = [("shape", "weight", "R²", "lack of fit", "optimum (95 %)")]
        for each in flight.get("models", ()):
            lack = f"p = {each['lack_of_fit_p']:.2g}" if each["lack_of_fit_p"] is not None else ""
            optimum = _interval(each["economic"] or each["agronomic"])
            shapes.append((each["name"], f"{100 * each['weight']:.0f} %", f"{each['r2']:.3f}", lack, optimum))
        if len(shapes) > 1:
            lines.append(aligned(shapes, 1))
        lines += [
            f"  {printable(part['label'])}: {printable(' '.join(part['sentences']))}"
            for part in flight.get("parts", ())
        ]
        lines += _variance_words(flight["variance"])
    return "\n".join([*lines, f"Written to {printable(str(output))}: {', '.join(account['products'])}"])


def _variance_words(variance: dict[str, Any] | None) -> list[str]:
    if variance is None:
        return []
    rows = [
        (
            f"F of {printable(row['source'])}",
            f"{row['f']:.2f} (p = {row['p']:.2g}, {row['freedom']} degrees of freedom)",
        )
        for row in variance["rows"]
        if row["f"] is not None
    ]
    means = [("mean of", "", "95 %", "letters")]
    means += [
        (
            printable(each["treatment"]),
            f"{each['mean']:.4g}",
            f"{each['low']:.4g} to {each['high']:.4g}",
            each["letters"],
        )
        for each in variance["means"]
    ]
    return [table(rows), *([aligned(means, 1)] if variance["means"] else [])] if rows else []


def _interval(value: dict[str, Any]) -> str:
    low = "" if value["low_open"] else f"{value['low']:.0f}"
    high = "above" if value["high_open"] else f"{value['high']:.0f}"
    return f"{value['value']:.0f} ({low} to {high})" if low else f"{value['value']:.0f} (to {high})"
