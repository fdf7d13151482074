"""The last lines of a run on a terminal: what a person wants to know first. `report.json` has the rest."""

import datetime as dt
import math
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Final
from zoneinfo import ZoneInfo

from furrowmap.core.geodesy.local_time import span_words
from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.languages.catalogue import translated
from furrowmap.core.values.margins import MARGIN_SIGMAS, margin
from furrowmap.exporters.files.result_folder import REPORT_PAGE
from furrowmap.exporters.reports.area_units import area_words

_SENTENCE_END: Final = re.compile(r"(?<=[.!?]) (?=\S)|(?<=。)")
_CODE: Final = "run-words"
"""Of the texts in the catalogues of languages."""
_FLYING: Final = ("imu", "trajectory", "parcels")
"""Tables of sessions that need no implement."""

Rows = Iterator[tuple[str, str]]


def run_words(report: Mapping[str, Any], folder: Path, language: str) -> str:
    """The main figures of a run with their margins, what is doubtful first of all, and the page to open.

    Args:
        report: the content of `report.json`.
        folder: that of the products.
    """
    figures = report["figures"]
    start_s, end_s = (dt.datetime.fromisoformat(figures[key]).timestamp() for key in ("start", "end"))
    span = span_words(start_s, end_s, ZoneInfo(figures["time_zone"]))
    title = printable(report["session"]["name"] or translated("Field report", language))
    rows = [
        *(_worked(report) if _knows_work(report) else ()),
        *_crops(report.get("parcels") or {}),
        *([("cloud", f"{figures['points']:,} points")] if figures["points"] else []),
        ("accuracy", _accuracy(report["accuracy"], consistent=not report["verdict"]["text"])),
    ]
    shown = [(translated(label, language, _CODE), translated(value, language, _CODE)) for label, value in rows]
    shown.append((translated("doubtful", language, _CODE), _doubtful(report, language)))
    page = translated(f"Open {printable(str(folder / REPORT_PAGE))}", language, _CODE)
    head = translated(f"{title}: {span}", language, _CODE)
    confidence = translated("± is twice the standard deviation (95 % confidence).", language)
    return "\n".join([head, "", *_aligned(shown), "", confidence, page])


def _knows_work(report: Mapping[str, Any]) -> bool:
    """Whether there is ground worked, or should be."""
    session = report["session"]
    return "worked_area_m2" in report["figures"] or not any(session.get(table) for table in _FLYING)


def _worked(report: Mapping[str, Any]) -> Rows:
    figures = report["figures"]
    unit = report["session"]["report"]["area_unit"]
    tools = figures.get("tools") or [figures]
    for tool in tools:
        about = f", {printable(tool['name'])}" if len(tools) > 1 else ""
        if "worked_area_m2" not in tool:
            stated = report["session"]["implement"] is not None
            reason = "unknown" if stated else "not computed, as the session states no implement"
            yield f"worked{about}", reason
            continue
        if not tool["passes"]:
            yield f"worked{about}", "nothing: the implement was never in the ground"
            continue
        passes = "1 pass" if tool["passes"] == 1 else f"{tool['passes']} passes"
        yield f"worked{about}", f"{_area(tool, 'worked', unit)} in {passes}"
        yield f"worked twice{about}", _area(tool, "overlap", unit)
        yield f"missed{about}", _area(tool, "missed", unit)
        if "unworked_area_m2" in tool:
            field = area_words(tool["field_area_m2"], unit)
            yield f"not worked{about}", f"{_area(tool, 'unworked', unit)} of {field} of field"
        implement = tool["implement"] or {}
        if implement.get("transitions") and implement["transition_sigma_s"]:
            sigma = margin(implement["transition_sigma_s"], " s")
            yield f"tool{about}", f"raised or lowered {implement['transitions']} times, {sigma}"


def _area(figures: Mapping[str, Any], name: str, unit: str) -> str:
    area_m2 = figures[f"{name}_area_m2"]
    return area_words(area_m2, unit, figures[f"{name}_area_sigma_m2"]) if area_m2 > 0.0 else "nothing"


def _crops(parcels: Mapping[str, Any]) -> Rows:
    """Heights and volume of the crops of all parcels, and their response to a dose."""
    rows = parcels.get("parcels") or ()
    heights_m = _known(row.get("mean_height_m") for row in rows)
    volumes_m3 = _known(row.get("volume_m3") for row in rows)
    if heights_m:
        mean, low, high = (100.0 * value for value in (fmean(heights_m), min(heights_m), max(heights_m)))
        many = f"{mean:.1f} cm on average ({len(heights_m)} parcels, {low:.1f} to {high:.1f} cm)"
        yield "crop height", many if len(heights_m) > 1 else f"{mean:.1f} cm (1 parcel)"
    if volumes_m3:
        yield "crop volume", f"{sum(volumes_m3):,.1f} m³"
    if parcels.get("response"):
        yield "response", parcels["response"]["sentences"][0]


def _known(values: Iterable[Any]) -> list[float]:
    return [value for value in values if isinstance(value, int | float) and math.isfinite(value)]


def _accuracy(accuracy: Mapping[str, Any], *, consistent: bool) -> str:
    """Margins of the positions, and the places in the session that they rest on."""
    east, north, up = (accuracy[f"sigma_{axis}_m"]["median"] for axis in "enh")
    if accuracy["unstated"]:
        return f"unknown, as the session leaves out {', '.join(accuracy['unstated'])}"
    across = math.hypot(east, north) if east is not None and north is not None else None
    words = f"{_distance(across)} horizontally, {_distance(up)} in height"
    keys = ", ".join(accuracy["unconfirmed"])
    return f"{words}, if the session is right about {keys}" if keys and consistent else words


def _distance(sigma_m: float | None) -> str:
    far = sigma_m is not None and MARGIN_SIGMAS * sigma_m >= 1.0
    return margin(sigma_m, " m") if far else margin(sigma_m, " cm", 100.0)


def _doubtful(report: Mapping[str, Any], language: str) -> str:
    """The first sentence of what to act on first; how many findings there are beside it."""
    found = report["verdict"]["findings"]
    others = sum(warning["follows"] is None for warning in report["warnings"]) - len(found)
    if not found:
        more = f"nothing; notes in the report: {others}" if others else "nothing"
        return translated(more, language, _CODE)
    text = found[0].get(f"text_{language}") or found[0]["text"]
    first = printable(_SENTENCE_END.split(text, maxsplit=1)[0])
    if len(found) == 1:
        return first
    more = translated(f"Further findings in the report: {len(found) - 1}.", language, _CODE)
    return f"{first}{'' if first.endswith('。') else ' '}{more}"


def _aligned(rows: Sequence[tuple[str, str]]) -> list[str]:
    width = max(_width(label) for label, _ in rows)
    return [f"  {label}{' ' * (width - _width(label))}  {value}" for label, value in rows]


def _width(text: str) -> int:
    """Columns of a terminal."""
    return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)
