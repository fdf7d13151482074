"""What people read in the tables of layers: names of fields with units, words for values, rounded figures, and actions.

They are parts of a style of QGIS (QML), which a GeoPackage holds in its table `layer_styles`; so QGIS shows them
without the plugin. Field names and values in the data stay the same in every language.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from furrowmap.core.runtime.languages.catalogue import translated

CATEGORIES: Final = "Fields|Forms|Actions"
"""Of QGIS's style categories: those that are added to a style."""
ALIASES: Final = {
    "pass": "pass",
    "pass_a": "earlier pass",
    "pass_b": "later pass",
    "start": "start (UTC)",
    "end": "end (UTC)",
    "time": "time (UTC)",
    "t_s": "POSIX time (s)",
    "length_m": "length (m)",
    "width_m": "width (m)",
    "area_m2": "area on the map (m²)",
    "area_ellipsoid_m2": "area on the ellipsoid (m²)",
    "area_sigma_m2": "standard deviation of the area (m²)",
    "worked_share": "share worked",
    "speed_mps": "speed (m/s)",
    "depth_m": "depth, approximate (m)",
    "depth_sigma_m": "standard deviation of the depth (m)",
    "depth_spread_m": "variation of the depth (m)",
    "kind": "kind",
    "zone": "zone",
    "implement": "tool",
    "implement_confidence": "confidence of the tool's state",
    "tool_height_m": "height of the tool (m)",
    "tool": "name of the tool",
    "tool_2": "name of the second tool",
    "implement_2": "second tool",
    "implement_2_confidence": "confidence of the second tool's state",
    "tool_2_height_m": "height of the second tool (m)",
    "pass_2": "pass of the second tool",
    "tool_3": "name of the third tool",
    "implement_3": "third tool",
    "implement_3_confidence": "confidence of the third tool's state",
    "tool_3_height_m": "height of the third tool (m)",
    "pass_3": "pass of the third tool",
    "scan": "scan",
    "roll_deg": "roll (°)",
    "pitch_deg": "pitch (°)",
    "heading_deg": "heading (°)",
    "motion": "motion",
    "fix": "kind of fix",
    "sigma_s": "standard deviation of the time (s)",
    "sigma_e_m": "standard deviation, easting (m)",
    "sigma_n_m": "standard deviation, northing (m)",
    "sigma_h_m": "standard deviation, height (m)",
    "sigma_roll_deg": "standard deviation, roll (°)",
    "sigma_pitch_deg": "standard deviation, pitch (°)",
    "sigma_heading_deg": "standard deviation, heading (°)",
    "heading_from": "source of the heading",
    "position_from": "source of the position",
    "height_from": "source of the height",
    "level_from": "source of roll and pitch",
    "strip": "strip",
    "strip_a": "earlier strip",
    "strip_b": "later strip",
    "before_m": "difference before (m)",
    "after_m": "difference after (m)",
    "sigma_m": "standard deviation (m)",
    "cell_m": "cell size (m)",
    "points": "points",
    "points_m2": "points per m²",
}
"""Names of fields for people, by name of the field."""
DIGITS: Final = {"m": 2, "m2": 1, "mps": 2, "deg": 2, "s": 3, "share": 3, "confidence": 2, "m3": 1, "h": 2, "hours": 2}
"""Decimals of a field by its unit, the end of its name."""
_STATES: Final = {"down": "tool down", "up": "tool up", "unknown": "unknown"}
VALUES: Final[Mapping[str, Mapping[str, str]]] = {
    "implement": _STATES,
    "implement_2": _STATES,
    "implement_3": _STATES,
    "motion": {"forward": "drives forward", "reverse": "drives backwards", "standing": "stop"},
    "zone": {"headland": "headland", "body": "body of the field"},
    "kind": {
        "down": "tool lowered",
        "up": "tool lifted",
        "stop": "stop",
        "start": "drives forward",
        "reverse": "drives backwards",
        "gap": "positions end",
        "between passes": "missed between passes",
        "boundary": "missed along the boundary",
        "horizontal": "horizontal plane",
        "vertical": "vertical plane",
        "pole": "pole, post or trunk",
        "wire": "wire or rail",
        "fence": "fence",
        "wall": "wall",
        "ditch": "ditch",
        "ridge": "ridge",
        "edge": "edge of a bank",
    },
    "fix": {
        "fixed": "RTK fixed",
        "float": "RTK float",
        "ppp": "PPP",
        "dgps": "differential",
        "single": "single",
        "none": "no position",
    },
}
"""Words for the values of a field, by its name."""
NAMES: Final = {
    "trajectory": "positions of the vehicle",
    "events": "events of the drive",
    "tool_path": "cultivated path",
    "coverage": "worked ground",
    "passes": "passes",
    "overlaps": "ground worked twice",
    "misses": "missed ground",
    "unworked": "ground not worked",
    "boundary": "boundary of the field",
    "zones": "headland and body",
    "parcels": "parcels",
    "strips": "strips of the flight",
    "strip_differences": "differences of strips",
    "planes": "planes",
    "lines": "lines",
    "plants": "plants",
}
"""Names of layers for people."""
_OPEN_URL: Final = 5
_FOLDER: Final = r"regexp_replace(layer_property(@layer, 'path'), '[^/\\\\]+$', '')"


def with_words(
    style: str,
    fields: Sequence[str],
    language: str,
    *,
    report: bool,
    aliases: Mapping[str, str] = ALIASES,
    values: Mapping[str, Mapping[str, str]] = VALUES,
) -> str:
    """A style of QGIS with aliases, widgets and actions for the fields of a layer.

    Args:
        style: QML, without fields.
        fields: names of the layer's fields.
        report: whether `report.html` lies beside the file.
        aliases: names of fields for people.
        values: words for the values of fields.
    """
    known = [(number, name) for number, name in enumerate(fields) if name in aliases]
    widgets = "".join(_widget(name, language, values.get(name)) for _, name in known)
    named = "".join(
        f'<alias index="{number}" field="{name}" name="{escape(translated(aliases[name], language))}"/>'
        for number, name in known
    )
    actions = _actions(language) if report else ""
    more = f"<fieldConfiguration>{widgets}</fieldConfiguration><aliases>{named}</aliases>{actions}"
    return style.replace('styleCategories="', f'styleCategories="{CATEGORIES}|', 1).replace("</qgis>", f"{more}</qgis>")


def _widget(name: str, language: str, words: Mapping[str, str] | None) -> str:
    if words is not None:
        pairs = "".join(
            f'<Option type="Map"><Option name="{escape(translated(word, language))}" value="{value}" type="QString"/>'
            "</Option>"
            for value, word in words.items()
        )
        return _configured(name, "ValueMap", f'<Option name="map" type="List">{pairs}</Option>')
    digits = DIGITS.get(name.rpartition("_")[2])
    if digits is None or name in ("t_s", "start", "end", "time"):
        return ""
    limits = '<Option name="Min" value="-1e300" type="double"/><Option name="Max" value="1e300" type="double"/>'
    options = f'{limits}<Option name="Precision" value="{digits}" type="int"/>'
    return _configured(name, "Range", f'{options}<Option name="Style" value="SpinBox" type="QString"/>')


def _configured(name: str, kind: str, options: str) -> str:
    config = f'<config><Option type="Map">{options}</Option></config>'
    return f'<field name="{name}"><editWidget type="{kind}">{config}</editWidget></field>'


def _actions(language: str) -> str:
    """Actions of a feature: the report in the browser, and the folder."""
    report, folder = (translated(name, language) for name in ("Open report", "Open folder"))
    url = f"'file://' || if(left({_FOLDER}, 1) = '/', '', '/') || {_FOLDER}"
    return "<attributeactions>{}</attributeactions>".format(
        "".join(
            f'<actionsetting type="{_OPEN_URL}" name="{escape(name)}" shortTitle="{escape(name)}" id="{{{key}}}" '
            f'action="{escape(f"[% {target} %]")}" capture="0" isEnabledOnlyWhenEditable="0" icon="" '
            'notificationMessage=""><actionScope id="Feature"/><actionScope id="Layer"/><actionScope id="Canvas"/>'
            "</actionsetting>"
            for key, name, target in (
                (
                    "6e1ce9d8-3f57-4c1b-9a58-0c1a4f6f2a01",
                    report,
                    f"{url} || 'report.html'",
                ),
                ("6e1ce9d8-3f57-4c1b-9a58-0c1a4f6f2a02", folder, url),
            )
        )
    )
