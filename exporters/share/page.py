"""A result as a web page without outside resources, read from disk or from any host."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from statistics import fmean
from typing import Any, Final, TypeGuard
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Proj, Transformer
from rasterio.enums import Resampling
from scipy import ndimage

from furrowmap.core.geodesy.local_time import local_time, zone_words
from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.runtime.errors import RefusedError, printable
from furrowmap.core.runtime.languages.texts import (
    LANGUAGES,
    SHARE,
    Text,
    Words,
    figure_text,
    in_every_language,
    texts_by_language,
)
from furrowmap.core.runtime.progress import Progress
from furrowmap.exporters.files.result_folder import CLOUD, ResultFolder, packaged_style, unreadable
from furrowmap.exporters.rasters.web_images import encode_image
from furrowmap.exporters.reports.area_units import HECTARE, area_text
from furrowmap.exporters.reports.html_pages import render
from furrowmap.exporters.reports.quantity_words import duration_words, margin_words
from furrowmap.exporters.share.page_features import MEASURES, moment_s, shared_layer
from furrowmap.exporters.share.page_points import BYTES_A_POINT, MAX_SHARED_POINTS, shared_points
from furrowmap.exporters.share.shown_layers import BLENDED, raster_style, rasters_of, shown_at_first, title_of

MAX_PICTURE_SIDE: Final = 2400
"""Pixels of the longer side of a picture."""
WEBP_QUALITY: Final = "85"


@dataclass(frozen=True)
class StyledPicture:
    """A raster in colours (rows, columns, 4), north on top; its box in its CRS; colours and labels of its classes."""

    rgba: NDArray[np.uint8]
    box_m: tuple[float, float, float, float]
    legend: tuple[tuple[str, str], ...]


def draw_raster(path: Path, style: str) -> StyledPicture:
    """The raster in a file, at most :data:`MAX_PICTURE_SIDE` pixels long, as its QGIS style draws it."""
    root = ET.fromstring(packaged_style(style))  # noqa: S314 - a file of this package
    renderer = next(root.iter("rasterrenderer"))
    with open_geotiff(path, lambda file, fault: unreadable(file, ValueError(fault)), with_heights=False) as raster:
        share = min(1.0, MAX_PICTURE_SIDE / max(raster.shape))
        shape = tuple(max(1, round(side * share)) for side in raster.shape)
        west, south, east, north = raster.bounds
        if renderer.get("type") == "multibandcolor":
            rgb = raster.read((1, 2, 3), out_shape=(3, *shape), resampling=Resampling.average)
            seen = raster.dataset_mask(out_shape=shape)
            return StyledPicture(np.dstack([*rgb, seen]).astype(np.uint8), (west, south, east, north), ())
        values = _values(raster, shape)
    if renderer.get("type") == "hillshade":
        cell_m = ((east - west) / shape[1], (north - south) / shape[0])
        return StyledPicture(_shaded(values, cell_m, renderer), (west, south, east, north), ())
    items = list(renderer.iter("item"))
    legend = tuple((str(item.get("color")), str(item.get("label"))) for item in items)
    return StyledPicture(_coloured(values, items), (west, south, east, north), legend)


def _values(raster: Any, shape: Sequence[int]) -> NDArray[np.float32]:
    """The first band, nan where it has no value."""
    band = raster.read(1, out_shape=tuple(shape), resampling=Resampling.average, masked=True)
    values: NDArray[np.float32] = band.astype(np.float32).filled(np.nan)
    return values


def _coloured(values: NDArray[np.float32], items: Sequence[ET.Element]) -> NDArray[np.uint8]:
    """Colours between those of the style's classes; transparent where there is no value."""
    stops = [float(str(item.get("value"))) for item in items]
    colours = [str(item.get("color")) for item in items]
    known = np.isfinite(values)
    out = np.zeros((*values.shape, 4), np.uint8)
    for channel in range(3):
        parts = [int(colour[1 + 2 * channel : 3 + 2 * channel], 16) for colour in colours]
        out[..., channel] = np.where(known, np.rint(np.interp(np.where(known, values, 0.0), stops, parts)), 255)
    opacity = [int(str(item.get("alpha", "255"))) for item in items]
    out[..., 3] = np.where(known, np.interp(np.where(known, values, 0.0), stops, opacity), 0)
    return out


def _shaded(height_m: NDArray[np.float32], cell_m: tuple[float, float], renderer: ET.Element) -> NDArray[np.uint8]:
    """Hillshade (Horn 1981, as GDAL's) with the light and the exaggeration of the style."""
    azimuth, above = (np.radians(float(str(renderer.get(key)))) for key in ("azimuth", "angle"))
    known = np.isfinite(height_m)
    if not known.any():
        return np.zeros((*height_m.shape, 4), np.uint8)
    row, column = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    whole = height_m[row, column].astype(np.float64) * float(str(renderer.get("zfactor")))
    east = ndimage.sobel(whole, axis=1) / (8.0 * cell_m[0])
    north = -ndimage.sobel(whole, axis=0) / (8.0 * cell_m[1])
    towards = np.sin(above) - np.cos(above) * (east * np.sin(azimuth) + north * np.cos(azimuth))
    light = np.clip(towards / np.sqrt(1.0 + east**2 + north**2), 0.0, 1.0)
    grey = np.round(255.0 * light)
    return np.dstack([grey, grey, grey, np.where(known, 255, 0)]).astype(np.uint8)


INDEX: Final = "index.html"
DATA_SCRIPT: Final = "data.js"
POINTS_SCRIPT: Final = "points.js"
SCRIPTS: Final = ("map.js", "cloud.js", "licences.txt")
SHARE_REPORT: Final = "share.json"
PAGE_PRODUCTS: Final = (INDEX, DATA_SCRIPT, POINTS_SCRIPT, *SCRIPTS, SHARE_REPORT)
"""Names by which a folder is known to hold a page; its pictures come on top."""
MAX_FOLDER_BYTES: Final = 30_000_000
"""Of a folder; the cloud takes what the other files leave."""
EXTENT_MARGIN_M: Final = 2.0


def write_page(staging: Path, result: ResultFolder, language: str, progress: Progress) -> list[str]:
    """Write the page, which begins in `language`, or "" for its reader's; raises RefusedError without its scripts."""
    bundle = files("furrowmap.exporters.share").joinpath("bundle")
    if not all(bundle.joinpath(name).is_file() for name in SCRIPTS):
        raise RefusedError("no-web-bundle")
    report = result.report
    zone = result.zone
    layers, extent, crs = _layers(result, zone)
    pictures = []
    rasters = rasters_of(result)
    for number, name in enumerate(rasters):
        progress("writing the page", 0.8 * number / len(rasters))
        pictures.append(_picture(staging, result, name))
    for name in SCRIPTS:
        (staging / name).write_text(bundle.joinpath(name).read_text("utf-8"), encoding="utf-8")
    data: dict[str, Any] = {
        "title": printable(result.name),
        "when": _when(report, zone),
        "alarms": list(_alarms(report.get("verdict") or {})),
        "warnings": [_notice(notice) for notice in report.get("warnings", ())],
        "figures": list(_figures(report)),
        "notes": list(_notes(report)),
        "about": list(_about(report, zone)),
        "crs": {"name": crs.name, "scale": _scale(crs, extent)},
        "extent": extent,
        "layers": [*layers, *pictures],
        "measures": MEASURES,
        "language": language,
        "languages": texts_by_language(SHARE),
    }
    _write_script(staging / DATA_SCRIPT, "furrowmapData", data | {"cloud": None})  # its size counts
    page = render("share.html", "script-src 'self'", "img-src 'self' data:", title=result.name, when=data["when"])
    (staging / INDEX).write_text(page, encoding="utf-8", errors="xmlcharrefreplace")
    progress("writing the page", 0.8)
    data["cloud"] = _write_points(staging, result, extent)
    _write_script(staging / DATA_SCRIPT, "furrowmapData", data)
    progress("writing the page", 1.0)
    return sorted(path.name for path in staging.iterdir())


def _write_script(path: Path, name: str, content: Any) -> None:
    """Data as a script that sets a global: a page from disk may read scripts, but no other files."""
    path.write_text(f"window.{name}={json.dumps(content, separators=(',', ':'), allow_nan=False)};\n", encoding="ascii")


def _layers(result: ResultFolder, zone: ZoneInfo) -> tuple[list[dict[str, Any]], Box, CRS]:
    """The vector layers, the topmost first; the bounds of all, with a margin; their CRS."""
    found = []
    boxes = []
    crs = None
    at_first = shown_at_first(result)
    for name in result.layer_names:
        layer = result.layer(name)
        shared = shared_layer(name, layer, zone, shown=name in at_first)
        crs = layer.crs
        if shared is not None:
            found.append(shared)
            boxes.append(layer.bounds)
    assert crs is not None
    lows = [min(box[i] for box in boxes) for i in (0, 1)]
    highs = [max(box[i] for box in boxes) for i in (2, 3)]
    box = (lows[0] - EXTENT_MARGIN_M, lows[1] - EXTENT_MARGIN_M, highs[0] + EXTENT_MARGIN_M, highs[1] + EXTENT_MARGIN_M)
    return found, box, CRS.from_user_input(crs).to_2d()


def _scale(crs: CRS, box: Box) -> float:
    """Length in the map's plane over length on the ellipsoid, in the middle of a box."""
    base = crs.geodetic_crs
    assert base is not None
    change = Transformer.from_crs(crs, base.to_2d(), always_xy=True)
    factors: Any = Proj(crs).get_factors(*change.transform(0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])))
    return math.sqrt(float(factors.areal_scale))


def _picture(staging: Path, result: ResultFolder, name: str) -> dict[str, Any]:
    shown = draw_raster(result.folder / name, raster_style(name))
    target = Path(name).with_suffix(".webp").name
    (staging / target).write_bytes(encode_image(shown.rgba, "WEBP", QUALITY=WEBP_QUALITY))
    return {
        "name": Path(name).stem,
        "title": title_of(name, result),
        "shown": Path(name).stem in shown_at_first(result),
        "multiply": name in BLENDED,
        "file": target,
        "extent": shown.box_m,
        "legend": [{"colour": colour, "label": label} for colour, label in shown.legend],
    }


def _write_points(staging: Path, result: ResultFolder, extent: Box) -> dict[str, Any] | None:
    """The points of the cloud, as many as there is room for; None for no cloud."""
    cloud = result.folder / CLOUD
    room = MAX_FOLDER_BYTES - sum(path.stat().st_size for path in staging.iterdir()) - 100_000
    most = min(MAX_SHARED_POINTS, room // BYTES_A_POINT)
    points = shared_points(cloud, most) if cloud.is_file() and most > 0 else None
    if points is None:
        return None
    _write_script(staging / POINTS_SCRIPT, "furrowmapPoints", points.plain(extent))
    return {"file": POINTS_SCRIPT, "points": len(points.xyz_m), "of": points.of}


def _when(report: dict[str, Any], zone: ZoneInfo) -> str:
    begin_s, end_s = (moment_s(report["figures"][key]) for key in ("start", "end"))
    begin = local_time(begin_s, zone)
    end = local_time(end_s, zone)
    later = "" if end.date() == begin.date() else f"{end:%Y-%m-%d} "
    return f"{begin:%Y-%m-%d %H:%M:%S} – {later}{end:%H:%M:%S} ({zone_words(begin_s, zone)})"


def _figures(report: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The key figures, as in `report.html`: value, name in words of the page, whether it calls for attention."""
    figures = report["figures"]
    for name, key in (("Worked", "worked"), ("Overlap", "overlap"), ("Missed", "missed"), ("Not worked", "unworked")):
        area_m2, sigma_m2 = figures.get(f"{key}_area_m2"), figures.get(f"{key}_area_sigma_m2")
        if _is_number(area_m2):
            value = area_text(area_m2, HECTARE, sigma_m2 if area_m2 > 0.0 else None)
            yield _figure(name, value, loud=name == "Missed" and area_m2 > 0.0)
    for name, value in _crops((report.get("parcels") or {}).get("parcels") or ()):
        yield _figure(name, value)
    hours = figures.get("hours") or {}
    shown = (
        ("Field", figures.get("field_area_m2"), lambda area_m2: area_text(area_m2, HECTARE)),
        ("Worked share of the field", figures.get("worked_share"), lambda share: figure_text(f"{share:.1%}")),
        ("Passes", figures.get("passes"), lambda passes: f"{passes:.0f}"),
        ("In the field", hours.get("field_s"), duration_words),
        (
            "Work rate, turns and stops included",
            figures.get("work_rate_ha_h"),
            lambda rate: figure_text(f"{rate:.2f} ha/h"),
        ),
        ("Mean speed at work", figures.get("working_speed_mps"), lambda speed: figure_text(f"{3.6 * speed:.1f} km/h")),
        ("Turning and reversing", hours.get("turning_s"), duration_words),
        ("Standing", hours.get("idle_s"), duration_words),
        ("Duration", None if hours else figures.get("duration_s"), duration_words),
        ("Path length", figures.get("distance_m"), lambda length: figure_text(f"{length:,.0f} m")),
        ("Points", figures.get("points") or None, lambda points: figure_text(f"{points:,.0f}")),
        *_accuracy(report.get("accuracy") or {}),
    )
    for name, value, words in shown:
        if _is_number(value):
            yield _figure(name, words(value))


def _figure(name: str, value: Words, *, loud: bool = False) -> dict[str, Any]:
    level = ["(±\u00a095\u00a0%)"] if "±" in str(value) else []
    return {"value": _said(value), "name": [name, *level], "loud": loud}


def _crops(parcels: Sequence[dict[str, Any]]) -> Iterator[tuple[str, Words]]:
    """How many parcels have a height, their heights, and the volume of all of them."""
    heights_m = [parcel["mean_height_m"] for parcel in parcels if _is_number(parcel.get("mean_height_m"))]
    if heights_m:
        mean, low, high = (100.0 * value for value in (fmean(heights_m), min(heights_m), max(heights_m)))
        volumes_m3 = [parcel["volume_m3"] for parcel in parcels if _is_number(parcel.get("volume_m3"))]
        yield "Parcels", str(len(heights_m))
        yield "Mean crop height", figure_text(f"{mean:.1f} cm")
        yield "Lowest to highest parcel", figure_text(f"{low:.1f} – {high:.1f} cm")
        if volumes_m3:
            yield "Crop volume", figure_text(f"{sum(volumes_m3):,.1f} m³")


def _notes(report: dict[str, Any]) -> Iterator[dict[str, str]]:
    """What the figures rest on, and how the heights of a trial's crop respond to its dose."""
    response = (report.get("parcels") or {}).get("response")
    if response:
        english = response.get("sentences", [response["words"]])
        said = [response.get(f"sentences_{language}", english) for language in LANGUAGES]
        for sentences in zip(*said, strict=False):
            yield dict(zip(LANGUAGES, (printable(str(sentence)) for sentence in sentences), strict=True))
    if keys := (report.get("accuracy") or {}).get("unconfirmed"):
        yield _said(
            Text(
                "The accuracy assumes that {keys} in the session is right: the recording cannot confirm it.",
                keys=", ".join(keys),
            )
        )


def _accuracy(accuracy: dict[str, Any]) -> Iterable[tuple[str, Any, Any]]:
    """Horizontal and vertical accuracy, where they are known."""
    east, north, up = ((accuracy.get(key) or {}).get("median") for key in ("sigma_e_m", "sigma_n_m", "sigma_h_m"))
    across = math.hypot(east, north) if _is_number(east) and _is_number(north) else None

    words = partial(margin_words, unit=" cm", factor=100.0)
    return (("Horizontal accuracy", across, words), ("Vertical accuracy", up, words))


def _about(report: dict[str, Any], zone: ZoneInfo) -> Iterator[tuple[str, str]]:
    coordinates = report["coordinates"]
    yield "Made with", f"furrowmap {version('furrowmap')}"
    yield "Recordings", printable(", ".join(str(record["name"]) for record in report["inputs"]))
    yield "Coordinates", printable(str(coordinates.get("crs") or report["session"]["crs"]["map"]))
    yield "Heights", printable(str(coordinates.get("heights") or report["session"]["crs"]["heights"]))
    yield "Time zone", zone.key


def _alarms(verdict: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Each cause, with what follows from it; of reports before they told it, a list of texts."""
    found = verdict.get("findings")
    if found is None:
        for text in (verdict.get("text"), *(verdict.get("doubts") or ())):
            if text:
                yield {"text": _said(str(text)), "follows": []}
        return
    for finding in found:
        yield {"text": _notice(finding), "follows": [_notice(notice) for notice in finding["follows"]]}


def _notice(notice: Mapping[str, Any]) -> dict[str, str]:
    """A warning in the languages of the page; reports of earlier versions have it in English alone."""
    english = notice.get("text", "")
    return {language: printable(str(notice.get(f"text_{language}", english))) for language in LANGUAGES}


def _said(text: Words) -> dict[str, str]:
    """A text in the languages of the page."""
    return {language: printable(said) for language, said in in_every_language(text).items()}


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and math.isfinite(value)
