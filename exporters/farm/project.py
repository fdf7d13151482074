"""The QGIS project of a farm map, stored as QGIS itself stores one, and the styles of its layers."""

import colorsys
import copy
import datetime as dt
import io
import json
import re
import zipfile
from collections.abc import Callable, Collection, Mapping, Sequence
from importlib.resources import files
from itertools import groupby
from typing import Final
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

from pyproj import CRS, Transformer

from furrowmap.core.runtime.languages.texts import SHARE, Text, texts_of
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.farm.edit import KnownSession
from furrowmap.exporters.farm.farm_memory_tables import DERIVED, FIELDS_LAYER, MACHINES, SEASONS, VISITS
from furrowmap.exporters.farm.farm_results import PROVENANCE, SESSIONS, TRACKS
from furrowmap.exporters.files.qgis_project import (
    ProjectLayer,
    project_root,
    project_text,
    put_point_cloud_layer,
    put_raster_layer,
    put_text,
    put_tree_layer,
    put_vector_layer,
    put_view,
)
from furrowmap.exporters.share.page_points import CLASS_COLOURS
from furrowmap.exporters.vectors.field_layers import Layer
from furrowmap.exporters.vectors.labels import COLUMN_LABELS, FARM_LABELS, FARM_LAYER_NAMES, VALUES
from furrowmap.exporters.vectors.qgis_styles import (
    DOCTYPE,
    StyleClock,
    extreme_fields,
    field_extremes,
    finished_style,
    with_words,
)

PROJECT: Final = "furrowmap"
"""Its name in the farm map."""
_TITLE: Final = Text("Farm map")
_OTHERS: Final = "Boundaries and zones"
"""The group of all other layers, too."""
_DETAILS: Final = "Work in detail"
"""A group that is hidden at first: what one session missed, another one may have worked."""
_GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "Fields": (FIELDS_LAYER, VISITS, SEASONS, MACHINES),
    "Sessions": (SESSIONS, TRACKS),
    _DETAILS: ("events", "tool_path", "misses", "unworked", "overlaps", "passes"),
    "Worked ground by day": ("coverage",),
    "Features": ("plants", "lines", "planes"),
    _OTHERS: ("boundary", "zones"),
    "Tables": (PROVENANCE,),
    "Ground": ("clouds", "surface"),
    "Background": ("background map",),
}
SURFACE: Final = "surface"
CLOUDS: Final = "clouds"
BACKGROUND: Final = "background map"
RASTER: Final = "raster"
POINT_CLOUD_WORDS: Final = "point cloud"
"""Layers that are not in the farm map, and their kinds."""
WEB_MERCATOR_CRS: Final = CRS("EPSG:3857")
_HIDDEN_AT_FIRST: Final = frozenset({TRACKS, VISITS, SEASONS, "zones", CLOUDS, BACKGROUND})
"""Among them the background map: only who shows it asks the network."""


_GSI: Final = (
    "gsi-photo",
    "GSI aerial photo",
    "https://cyberjapandata.gsi.go.jp/xyz/seamlessphoto/{z}/{x}/{y}.jpg",
    18,
    "Geospatial Information Authority of Japan (GSI) tiles",
)
_OSM: Final = (
    "osm", "OpenStreetMap", "https://tile.openstreetmap.org/{z}/{x}/{y}.png", 19, "© OpenStreetMap contributors"
)  # fmt: skip
"""Key by which the QGIS plugin knows the map, title, tiles, their last level, and what a map has to show."""
_JAPAN_DEG: Final = (122.0, 20.0, 154.0, 46.0)


def project_metadata(user: str) -> str:
    """The JSON that QGIS stores beside a project."""
    moment = dt.datetime.now(dt.UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return json.dumps({"last_modified_time": moment, "last_modified_user": user})


def project_archive(
    layers: Sequence[ProjectLayer],
    crs: CRS,
    bounds: tuple[float, float, float, float],
    span: tuple[dt.datetime, dt.datetime],
) -> bytes:
    """The project as a `.qgz`, topmost layer first; the temporal controller has steps of a day."""
    root = project_root(_TITLE.in_language(language_of_user()), crs)
    _put_tree(root, layers)
    _put_relations(root, layers)
    within = ET.SubElement(root, "projectlayers")
    words = texts_of(language_of_user(), SHARE)
    classes = [(code, colour, words.get(name, name)) for code, colour, name in CLASS_COLOURS]
    for layer in layers:
        if layer.kind == POINT_CLOUD_WORDS:
            put_point_cloud_layer(within, layer, crs, classes)
        elif layer.kind == RASTER:
            put_raster_layer(within, layer, WEB_MERCATOR_CRS if layer.name == BACKGROUND else crs)
        else:
            put_vector_layer(within, layer, crs)
    order = ET.SubElement(root, "layerorder")
    for layer in layers:
        ET.SubElement(order, "layer", {"id": layer.id})
    settings = {"timeStep": "1", "timeStepUnit": "d", "frameRate": "1", "cumulativeTemporalRange": "0"}
    times = ET.SubElement(ET.SubElement(root, "ProjectTimeSettings", settings), "TemporalRange")
    begin, end = (moment.astimezone(dt.UTC) for moment in span)
    put_text(times, "start", begin.strftime("%Y-%m-%dT00:00:00Z"))
    put_text(times, "end", (end + dt.timedelta(days=1)).strftime("%Y-%m-%dT00:00:00Z"))
    put_view(root, crs, bounds)
    archive = io.BytesIO()
    entry = zipfile.ZipInfo(f"{PROJECT}.qgs")  # dated 1980: the same project is the same archive
    entry.compress_type = zipfile.ZIP_DEFLATED
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr(entry, project_text(root))
    return archive.getvalue()


def layer_title(name: str) -> str:
    """The name of a layer for people, in the user's language; a layer of others keeps its own."""
    if name not in FARM_LAYER_NAMES:
        return name
    words = _in_words(FARM_LAYER_NAMES[name])
    return words[:1].upper() + words[1:]


def _in_words(label: str) -> str:
    return texts_of(language_of_user()).get(label, label)


def background_layer(crs: CRS, bounds: tuple[float, float, float, float]) -> ProjectLayer:
    """Tiles for a place: aerial photos of the Geospatial Information Authority in Japan, else OpenStreetMap."""
    to_lon_lat = Transformer.from_crs(crs.to_2d(), "EPSG:4326", always_xy=True)
    longitude, latitude = to_lon_lat.transform(0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3]))
    west, south, east, north = _JAPAN_DEG
    key, title, url, zmax, owner = _GSI if west < longitude < east and south < latitude < north else _OSM
    attribution = _in_words(owner)
    return ProjectLayer(
        BACKGROUND,
        RASTER,
        f"type=xyz&url={url}&zmax={zmax}&zmin=0",
        "wms",
        None,
        _in_words(title),
        properties=(
            ("furrowmap/basemap", key),
            ("furrowmap/attribution", attribution),
            ("furrowmap/probe", re.sub(r"\{[xyz]\}", "0", url)),
        ),
        attribution=attribution,
    )


def _put_tree(root: ET.Element, layers: Sequence[ProjectLayer]) -> None:
    tree = ET.SubElement(root, "layer-tree-group")
    named = {name for names in _GROUPS.values() for name in names}
    for title, names in _GROUPS.items():
        inside = [x for x in layers if x.name in names or (title == _OTHERS and x.name not in named)]
        if not inside:
            continue
        name = _in_words(title)
        folded = title == _DETAILS
        state = {"checked": "Qt::Unchecked" if folded else "Qt::Checked", "expanded": str(int(not folded))}
        group = ET.SubElement(tree, "layer-tree-group", {"name": name, **state})
        for layer in inside:
            shown = layer.name not in _HIDDEN_AT_FIRST
            put_tree_layer(group, layer, checked=shown, expanded=layer.name == "coverage")


def _put_relations(root: ET.Element, layers: Sequence[ProjectLayer]) -> None:
    """From every session to its features, for QGIS's forms."""
    relations = ET.SubElement(root, "relations")
    (sessions,) = (layer for layer in layers if layer.name == SESSIONS)
    for layer in layers:
        if layer is sessions or layer.name in DERIVED - {VISITS} or layer.kind in (RASTER, POINT_CLOUD_WORDS):
            continue
        attributes = {
            "id": f"furrowmap_{layer.name}_of_session",
            "name": layer.title or layer.name,
            "referencingLayer": layer.id,
            "referencedLayer": sessions.id,
            "strength": "Association",
        }
        fields = {"referencingField": "session", "referencedField": "session"}
        ET.SubElement(ET.SubElement(relations, "relation", attributes), "fieldRef", fields)


_BY_DATE: Final = "coverage"
_BARE: Final = DOCTYPE + '<qgis version="3.34.0" styleCategories="Rendering"></qgis>\n'
_OF_SESSIONS: Final = frozenset({SESSIONS, VISITS, MACHINES})
"""Layers whose `implement` is the kind of the tool, not its state."""
_HUES: Final = (0.14, 0.62)
"""From the first day (yellow) over green to the last (blue)."""


def styles(
    layers: Mapping[str, Collection[str]],
    sessions: Sequence[KnownSession],
    read: Callable[[str, Sequence[str]], Layer],
) -> dict[str, str]:
    """The styles (QML) of layers, given with the names of their fields, in the language of the user.

    `read` gives a layer with some of its columns. Map tips show the local time of each session, and name its zone.
    Worked ground has a colour for each day.
    """
    found = {name: text for name in layers if (text := _packaged(name)) is not None}
    if _BY_DATE in found:
        found[_BY_DATE] = _by_date(found[_BY_DATE], [session.date for session in sessions])
    language = language_of_user()
    aliases = {**COLUMN_LABELS, **FARM_LABELS}
    clocks = _clocks(sessions)
    for name, text in found.items():
        ranked = extreme_fields(text)
        extremes = field_extremes(read(name, ranked).columns) if ranked else {}
        found[name] = finished_style(text, language, clocks, extremes)
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
        first_s = min(one.start.timestamp() for one in of_zone)
        last_s = max(one.end.timestamp() for one in of_zone)
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
    categories = root.find(".//categories")
    symbols = root.find(".//symbols")
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
