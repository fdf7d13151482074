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
from furrowmap.core.runtime.languages.texts import Text, Words, figure_text, in_language
from furrowmap.core.values.margins import MARGIN_SIGMAS
from furrowmap.exporters.files.result_folder import REPORT_PAGE
from furrowmap.exporters.reports.area_units import area_text
from furrowmap.exporters.reports.quantity_words import NOT_KNOWN, margin_words

_SENTENCE_END: Final = re.compile(r"(?<=[.!?]) (?=\S)|(?<=。)")
_FLYING: Final = ("imu", "trajectory", "parcels")
"""Tables of sessions that need no implement."""

Rows = Iterator[tuple[Text, Words]]


def run_words(report: Mapping[str, Any], folder: Path, language: str) -> str:
    """The main figures of a run with their margins, what is doubtful first of all, and the page to open.

    Args:
        report: the content of `report.json`.
        folder: that of the products.
    """
    figures = report["figures"]
    start_s, end_s = (dt.datetime.fromisoformat(figures[key]).timestamp() for key in ("start", "end"))
    span = span_words(start_s, end_s, ZoneInfo(figures["time_zone"]))
    title = printable(report["session"]["name"] or Text("Field report").in_language(language))
    rows: list[tuple[Text, Words]] = [
        *(_worked(report) if _knows_work(report) else ()),
        *_crops(report.get("parcels") or {}, language),
        *([(Text("cloud"), Text("{points:,} points", points=figures["points"]))] if figures["points"] else []),
        (Text("accuracy"), _accuracy(report["accuracy"], consistent=not report["verdict"]["text"])),
        (Text("doubtful"), _doubtful(report, language)),
    ]
    shown = [(label.in_language(language), str(in_language(value, language))) for label, value in rows]
    page = Text("Open {page}", page=printable(str(folder / REPORT_PAGE))).in_language(language)
    confidence = Text("± is twice the standard deviation (95 % confidence).").in_language(language)
    return "\n".join([f"{title}: {span.in_language(language)}", "", *_aligned(shown), "", confidence, page])


def _knows_work(report: Mapping[str, Any]) -> bool:
    """Whether there is ground worked, or should be."""
    session = report["session"]
    return "worked_area_m2" in report["figures"] or not any(session.get(table) for table in _FLYING)


def _worked(report: Mapping[str, Any]) -> Rows:
    figures = report["figures"]
    unit = report["session"]["report"]["area_unit"]
    tools = figures.get("tools") or [figures]
    for tool in tools:
        name = printable(tool["name"]) if len(tools) > 1 else None
        worked = Text("worked{tool:, {tool}|}", tool=name)
        if "worked_area_m2" not in tool:
            stated = report["session"]["implement"] is not None
            yield worked, NOT_KNOWN if stated else Text("not computed, as the session states no implement")
            continue
        if not tool["passes"]:
            yield worked, Text("nothing: the implement was never in the ground")
            continue
        area = _area(tool, "worked", unit)
        if tool["passes"] == 1:
            yield worked, Text("{area} in 1 pass", area=area)
        else:
            yield worked, Text("{area} in {passes} passes", area=area, passes=tool["passes"])
        yield Text("worked twice{tool:, {tool}|}", tool=name), _area(tool, "overlap", unit)
        yield Text("missed{tool:, {tool}|}", tool=name), _area(tool, "missed", unit)
        if "unworked_area_m2" in tool:
            left = Text(
                "{area} of {field} of field",
                area=_area(tool, "unworked", unit),
                field=area_text(tool["field_area_m2"], unit),
            )
            yield Text("not worked{tool:, {tool}|}", tool=name), left
        implement = tool["implement"] or {}
        if implement.get("transitions") and implement["transition_sigma_s"]:
            sigma = margin_words(implement["transition_sigma_s"], " s")
            times = implement["transitions"]
            moved = Text("raised or lowered {times} times, {margin}", times=times, margin=sigma)
            yield Text("tool{tool:, {tool}|}", tool=name), moved


def _area(figures: Mapping[str, Any], name: str, unit: str) -> Words:
    area_m2 = figures[f"{name}_area_m2"]
    return area_text(area_m2, unit, figures[f"{name}_area_sigma_m2"]) if area_m2 > 0.0 else Text("nothing")


def _crops(parcels: Mapping[str, Any], language: str) -> Rows:
    """Heights and volume of the crops of all parcels, and their response to a dose."""
    rows = parcels.get("parcels") or ()
    heights_m = _known(row.get("mean_height_m") for row in rows)
    volumes_m3 = _known(row.get("volume_m3") for row in rows)
    if heights_m:
        mean, low, high = (100.0 * value for value in (fmean(heights_m), min(heights_m), max(heights_m)))
        if len(heights_m) == 1:
            said = Text("{mean:.1f} cm (1 parcel)", mean=mean)
        else:
            said = Text(
                "{mean:.1f} cm on average ({parcels} parcels, {low:.1f} to {high:.1f} cm)",
                mean=mean,
                parcels=len(heights_m),
                low=low,
                high=high,
            )
        yield Text("crop height"), said
    if volumes_m3:
        yield Text("crop volume"), figure_text(f"{sum(volumes_m3):,.1f} m³")
    if response := parcels.get("response"):
        yield Text("response"), str(response.get(f"sentences_{language}", response["sentences"])[0])


def _known(values: Iterable[Any]) -> list[float]:
    return [value for value in values if isinstance(value, int | float) and math.isfinite(value)]


def _accuracy(accuracy: Mapping[str, Any], *, consistent: bool) -> Text:
    """Margins of the positions, and the places in the session that they rest on."""
    east, north, up = (accuracy[f"sigma_{axis}_m"]["median"] for axis in "enh")
    if accuracy["unstated"]:
        return Text("unknown, as the session leaves out {keys}", keys=", ".join(accuracy["unstated"]))
    across = _distance(math.hypot(east, north) if east is not None and north is not None else None)
    height = _distance(up)
    keys = ", ".join(accuracy["unconfirmed"])
    if not (keys and consistent):
        return Text("{across} horizontally, {up} in height", across=across, up=height)
    return Text(
        "{across} horizontally, {up} in height, if the session is right about {keys}",
        across=across,
        up=height,
        keys=keys,
    )


def _distance(sigma_m: float | None) -> Words:
    far = sigma_m is not None and MARGIN_SIGMAS * sigma_m >= 1.0
    return margin_words(sigma_m, " m") if far else margin_words(sigma_m, " cm", 100.0)


def _doubtful(report: Mapping[str, Any], language: str) -> Words:
    """The first sentence of what to act on first; how many findings there are beside it."""
    found = report["verdict"]["findings"]
    others = sum(warning["follows"] is None for warning in report["warnings"]) - len(found)
    if not found:
        return Text("nothing; notes in the report: {notes}", notes=others) if others else Text("nothing")
    text = found[0].get(f"text_{language}") or found[0]["text"]
    first = printable(_SENTENCE_END.split(text, maxsplit=1)[0])
    if len(found) == 1:
        return first
    return Text("{first} Further findings in the report: {others}.", first=first, others=len(found) - 1)


def _aligned(rows: Sequence[tuple[str, str]]) -> list[str]:
    width = max(_width(label) for label, _ in rows)
    return [f"  {label}{' ' * (width - _width(label))}  {value}" for label, value in rows]


def _width(text: str) -> int:
    """Columns of a terminal."""
    return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)
