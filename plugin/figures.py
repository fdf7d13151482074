# SPDX-License-Identifier: GPL-2.0-or-later
"""The main figures of a report: areas worked, overlapped and missed, and the accuracy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from html import escape
from typing import Any

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication, QDateTime, Qt

from .dock_words import in_dock_words
from .translation import in_marks

tr = partial(QCoreApplication.translate, "Figures")

ON_PAPER = "#b71c1c"
"""Red of findings on white."""
MOST = 1e15
"""No figure is larger."""


def figure_rows(report: dict[str, Any]) -> list[tuple[str, str]]:
    """Pairs of a label and a value with its unit, from a report."""
    figures = object_in(report, "figures")
    accuracy = object_in(report, "accuracy")
    rows = [
        (tr("Start"), _local_time(figures)),
        (tr("Worked"), _area(figures, "worked_area_m2", "worked_area_sigma_m2")),
        (tr("Overlap"), _area(figures, "overlap_area_m2", "overlap_area_sigma_m2")),
        (tr("Missed"), _area(figures, "missed_area_m2", "missed_area_sigma_m2")),
        (tr("Field"), _field(figures)),
        (tr("Not worked"), _area(figures, "unworked_area_m2", "unworked_area_sigma_m2")),
        (tr("Passes"), _number(figures.get("passes"), "{:.0f}")),
        *_crop_rows(object_in(report, "parcels")),
        (tr("Path length"), _path_length(figures.get("distance_m"))),
        (tr("Duration"), _duration(figures.get("duration_s"))),
        (tr("Points"), _number(figures.get("points") or None, "{:,.0f}")),
        (tr("Horizontal accuracy"), _accuracy(accuracy, ("sigma_e_m", "sigma_n_m"), 100.0, " cm")),
        (tr("Vertical accuracy"), _accuracy(accuracy, ("sigma_h_m",), 100.0, " cm")),
        (tr("Heading accuracy"), _accuracy(accuracy, ("sigma_heading_deg",), 1.0, "°")),
        (tr("Accuracy"), _conditions(accuracy)),
        (tr("Positions"), _fixes(figures.get("fix"))),
        (tr("CRS"), figures.get("crs")),
    ]
    return [(label, str(value)) for label, value in rows if value]


def object_in(report: dict[str, Any], key: str) -> dict[str, Any]:
    """A table of a report; empty if there is none."""
    value = report.get(key)
    return value if isinstance(value, dict) else {}


def figures_html(report: dict[str, Any]) -> str:
    """The same as the rows of a table in HTML."""
    return "".join(
        f"<tr><td>{escape(label)}&nbsp;&nbsp;</td><td><b>{escape(value)}</b></td></tr>"
        for label, value in figure_rows(report)
    )


def verdict_html(report: dict[str, Any], colour: str = ON_PAPER) -> str:
    """What stands above the figures: contradictions and doubts, each cause with what follows from it."""
    verdict = object_in(report, "verdict")
    found = verdict.get("findings")
    if isinstance(found, list):
        return "".join(_finding_html(finding, colour) for finding in found if isinstance(finding, dict))
    text = localized(verdict, "text")
    doubts = localized(verdict, "doubts")
    shown = "".join(f"<p>⚠ {escape(str(doubt))}</p>" for doubt in (doubts if isinstance(doubts, list) else []))
    if not text:
        return shown
    return f"<p style='color:{colour}'><b>{escape(str(text))}</b></p>{shown}"


def texts_above(report: dict[str, Any]) -> set[str]:
    """The texts, in English, of the warnings in :func:`verdict_html`."""
    verdict = object_in(report, "verdict")
    found = [finding for finding in verdict.get("findings") or [] if isinstance(finding, dict)]
    notices = [one for finding in found for one in (finding, *(finding.get("follows") or [])) if isinstance(one, dict)]
    return {str(text) for text in (verdict.get("text"), *(verdict.get("doubts") or []))} | {
        str(notice.get("text")) for notice in notices
    }


def _finding_html(finding: dict[str, Any], colour: str) -> str:
    follows = finding.get("follows")
    items = "".join(
        f"<li>{escape(str(localized(one, 'text')))}</li>"
        for one in (follows if isinstance(follows, list) else [])
        if isinstance(one, dict)
    )
    cause = f"<p style='color:{colour}'><b>⚠ {escape(str(localized(finding, 'text')))}</b></p>"
    return f"{cause}<p>{tr('This explains:')}</p><ul style='margin-left:-20px'>{items}</ul>" if items else cause


def localized(table: dict[str, Any], key: str) -> Any:
    """A text of a report, or a list of texts, in the language of QGIS if the report has it, as `text_ja` beside `text`.

    In the words of the dialogs.
    """
    found = table.get(f"{key}_{(QgsApplication.locale() or '')[:2]}") or table.get(key)
    if isinstance(found, list):
        return [in_dock_words(each) if isinstance(each, str) else each for each in found]
    return in_dock_words(found) if isinstance(found, str) else found


def local_start(figures: dict[str, Any]) -> tuple[QDateTime, str]:
    """The start in the field's local time, and the zone; in that of this computer where an old report has no zone."""
    zone = figures.get("time_zone")
    moment = QDateTime.fromString(str(figures.get("start_local" if zone else "start")), Qt.DateFormat.ISODateWithMs)
    if zone or not moment.isValid():
        return moment, zone or ""
    moment = moment.toLocalTime()
    return moment, moment.timeZoneAbbreviation()


def _local_time(figures: dict[str, Any]) -> str | None:
    moment, zone = local_start(figures)
    return f"{moment.toString('yyyy-MM-dd HH:mm')} ({zone})" if moment.isValid() else None


def _fixes(shares: Any) -> str | None:
    """How much of the time the receiver had each quality of position, the most frequent first."""
    if not isinstance(shares, dict):
        return None
    known = sorted(((share, fix) for fix, share in shares.items() if isinstance(share, (int, float))), reverse=True)
    words = {
        "fixed": tr("RTK fixed"),
        "float": tr("RTK float"),
        "ppp": tr("PPP"),
        "dgps": tr("differential"),
        "single": tr("single"),
        "none": tr("no position"),
    }
    return ", ".join(f"{words.get(fix, tr('other'))} {_percent(share)}" for share, fix in known)


def _percent(share: float) -> str:
    """A share that is neither rounded up to all nor down to nothing."""
    if 0.0 < share < 0.001:
        return in_marks("< 0.1 %")
    said = "> 99.9 %" if 0.999 < share < 1.0 else f"{100.0 * share:.{0 if share in (0.0, 1.0) else 1}f} %"
    return in_marks(said)


def _crop_rows(crops: dict[str, Any]) -> list[tuple[str, str | None]]:
    """The crops of a trial: how many parcels, their heights, and the volume of all of them."""
    parcels = [parcel for parcel in crops.get("parcels") or [] if isinstance(parcel, dict)]
    heights = sorted(h for parcel in parcels if isinstance(h := parcel.get("mean_height_m"), (int, float)))
    if not heights:
        return []
    words = tr("{low:.1f} to {high:.1f} cm, mean {mean:.1f} cm")
    mean = sum(heights) / len(heights)
    volumes = [v for parcel in parcels if isinstance(v := parcel.get("volume_m3"), (int, float))]
    return [
        (tr("Parcels"), str(len(heights))),
        (tr("Crop height"), in_marks(words.format(low=100 * heights[0], high=100 * heights[-1], mean=100 * mean))),
        (tr("Crop volume"), _number(sum(volumes) or None, "{:,.1f} m³")),
        (tr("Response"), localized(object_in(crops, "response"), "words")),
    ]


def _number(value: Any, form: str) -> str | None:
    """A number in a form; None for what cannot be measured, such as 300 digits of a damaged report."""
    return in_marks(form.format(value)) if isinstance(value, (int, float)) and abs(value) < MOST else None


def _path_length(metres: Any) -> str | None:
    """A length in metres, above ten kilometres in kilometres."""
    return _number(metres, "{:,.0f} m") if not metres or metres < 1e4 else in_marks(f"{metres / 1e3:,.1f} km")


def _duration(seconds: Any) -> str | None:
    """Seconds, above ten minutes hours and minutes."""
    if not isinstance(seconds, (int, float)) or not 600 <= seconds < MOST:
        return _number(seconds, "{:,.0f} s")
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02d} min"


def _area(figures: dict[str, Any], key: str, sigma_key: str) -> str | None:
    """An area in m², from 1,000 m² on in hectares as on pages, with its margin of error."""
    area = figures.get(key)
    sigma = figures.get(sigma_key)
    if not isinstance(area, (int, float)):
        return None
    factor, form, unit = (1e-4, "{:,.3f}", "ha") if area >= 1e3 else (1.0, f"{{:,.{1 if area >= 10 else 2}f}}", "m²")
    if not isinstance(sigma, (int, float)) or sigma <= 0 or area <= 0:
        return in_marks(f"{form.format(area * factor)} {unit}")
    half = 2 * factor * sigma
    value = in_marks(f"{factor * area:,.{max(0, _places(half))}f}")
    return f"{value} {_margin(half)} {unit} (95 %)"


def _field(figures: dict[str, Any]) -> str | None:
    """Area of the field, and how much of it was worked."""
    area = _area(figures, "field_area_m2", "")
    share = figures.get("worked_share")
    if area is None or not isinstance(share, (int, float)):
        return area
    return tr("{area}, {share:.0f} % of it worked").format(area=area, share=100.0 * share)


def _conditions(accuracy: dict[str, Any]) -> str | None:
    """Why no accuracy is stated, or what the stated one rests on."""
    places = {
        "antenna.xyz_m": tr("position of the antenna"),
        "lidar.xyz_m": tr("position of the scanner"),
        "lidar.rpy_deg": tr("orientation of the scanner"),
    }
    for key, text in (
        ("unstated", tr("unknown, because the session leaves out: {keys}")),
        ("unconfirmed", tr("depends on what the recording does not show: {keys}")),
    ):
        keys = accuracy.get(key)
        if keys and isinstance(keys, list):
            return text.format(keys=tr(", ").join(places.get(str(each), str(each)) for each in keys))
    return None


def _accuracy(accuracy: dict[str, Any], keys: Sequence[str], factor: float, unit: str) -> str | None:
    """The median margin of error: twice a standard deviation, of several components that of their vector."""
    medians: list[Any] = [(accuracy.get(key) or {}).get("median") for key in keys]
    if not all(isinstance(value, (int, float)) for value in medians):
        return None
    half = 2 * factor * sum(value * value for value in medians) ** 0.5
    return f"{_margin(half)}{unit} (95 %)" if half > 0 else None


def _margin(half: float) -> str:
    """A margin of error to two significant digits, as the pages of furrowmap have it."""
    places = _places(half)
    return in_marks(f"± {round(half, places):,.{max(0, places)}f}")


def _places(half: float) -> int:
    return 1 - math.floor(math.log10(half))
