"""QGIS styles of the layers of a farm map: a run's own, and those of layers that only a farm map has."""

import colorsys
import copy
import datetime as dt
from collections.abc import Collection, Mapping, Sequence
from importlib.resources import files
from itertools import groupby
from typing import Final
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.farm.edit import KnownSession
from furrowmap.exporters.farm.memory import MACHINES, VISITS
from furrowmap.exporters.farm.results import SESSIONS
from furrowmap.exporters.files.qgis_project import DOCTYPE
from furrowmap.exporters.vectors.labels import COLUMN_LABELS, FARM_LABELS, VALUES
from furrowmap.exporters.vectors.qgis_styles import StyleClock, in_language, in_local_times, with_words

_BY_DATE: Final = "coverage"
_BARE: Final = DOCTYPE + '<qgis version="3.34.0" styleCategories="Rendering"></qgis>\n'
_OF_SESSIONS: Final = frozenset({SESSIONS, VISITS, MACHINES})
"""Layers whose `implement` is the kind of the tool, not its state."""
_HUES: Final = (0.14, 0.62)
"""From the first day (yellow) over green to the last (blue)."""


def styles(layers: Mapping[str, Collection[str]], sessions: Sequence[KnownSession]) -> dict[str, str]:
    """The styles (QML) of layers, given with the names of their fields, in the language of the user.

    Map tips show the local time of each session, and name its zone. Worked ground has a colour for each day.
    """
    found = {name: text for name in layers if (text := _packaged(name)) is not None}
    if _BY_DATE in found:
        found[_BY_DATE] = _by_date(found[_BY_DATE], [session.date for session in sessions])
    found = {name: in_language(text, language_of_user()) for name, text in found.items()}
    clocks = _clocks(sessions)
    if clocks:
        found = {name: in_local_times(text, clocks) for name, text in found.items()}
    language, aliases = language_of_user(), {**COLUMN_LABELS, **FARM_LABELS}
    plain = {name: labels for name, labels in VALUES.items() if name != "implement"}
    return {
        name: with_words(found.get(name, _BARE), sorted(fields), language, report=False, aliases=aliases, values=values)
        for name, fields in layers.items()
        for values in (plain if name in _OF_SESSIONS else VALUES,)
    }


def _clocks(sessions: Sequence[KnownSession]) -> list[StyleClock]:
    """The zones of the sessions, that of most sessions first."""
    ordered = sorted(sessions, key=lambda session: session.time_zone)
    clocks = []
    for zone, group in groupby(ordered, lambda session: session.time_zone):
        of_zone = list(group)
        first_s, last_s = min(one.start.timestamp() for one in of_zone), max(one.end.timestamp() for one in of_zone)
        clocks.append(StyleClock(ZoneInfo(zone), first_s, last_s, tuple(sorted(one.session for one in of_zone))))
    return sorted(clocks, key=lambda clock: -len(clock.sessions))


def _packaged(name: str) -> str | None:
    for package in ("furrowmap.exporters.farm", "furrowmap.exporters"):
        file = files(package).joinpath("styles", f"{name}.qml")
        if file.is_file():
            return file.read_text("utf-8")
    return None


def _by_date(text: str, dates: Sequence[dt.date]) -> str:
    """The style with a category for each day, and one for all other days."""
    root = ET.fromstring(text)  # noqa: S314 (a file of this package)
    categories, symbols = root.find(".//categories"), root.find(".//symbols")
    assert categories is not None
    assert symbols is not None
    (pattern,) = symbols
    days = sorted(set(dates))
    for i, date in enumerate(days):
        category = {"type": "string", "value": date.isoformat(), "label": date.isoformat()}
        ET.SubElement(categories, "category", category | {"symbol": str(i), "render": "true"})
        symbol = copy.deepcopy(pattern)
        symbol.set("name", str(i))
        hue = _HUES[0] + i / max(len(days) - 1, 1) * (_HUES[1] - _HUES[0])
        rgb = (round(255 * value) for value in colorsys.hls_to_rgb(hue, 0.5, 0.65))
        option = symbol.find(".//Option[@name='color']")
        assert option is not None
        option.set("value", "{},{},{},255".format(*rgb))
        symbols.append(symbol)
    rest = {"type": "NULL", "value": "", "label": "other days", "symbol": str(len(days)), "render": "true"}
    ET.SubElement(categories, "category", rest)
    pattern.set("name", str(len(days)))
    return DOCTYPE + ET.tostring(root, encoding="unicode") + "\n"
