"""What people read in QGIS styles (QML): labels, map tips and their local times, words for values, actions.

A GeoPackage holds the styles in its table `layer_styles`; so QGIS shows these words without the plugin. Field names and
values in the data stay the same in every language.
"""

import datetime as dt
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape, unescape
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.geodesy.local_time import local_time
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.languages.texts import ENGLISH, Text, in_marks, texts_of
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.files.result_folder import packaged_style, style_of
from furrowmap.exporters.vectors.labels import COLUMN_LABELS, VALUES

_CATEGORIES: Final = "Fields|Forms|Actions"
"""Of QGIS's style categories: those that are added to a style."""
_DECIMALS: Final = {
    "m": 2, "m2": 1, "m3": 1, "mps": 2, "deg": 2, "s": 3, "h": 2, "hours": 2, "share": 3, "confidence": 2,
}  # fmt: skip
"""Decimals of a field by its unit, the end of its name."""
_OPEN_URL: Final = 5
_FOLDER: Final = r"regexp_replace(layer_property(@layer, 'path'), '[^/\\\\]+$', '')"
_LABELLED_TAGS: Final = ("category", "item", "range", "rule")
"""Elements of renderers that have a label."""
_LINE: Final = re.compile(r"<br>|(?:\[%.*?%\]|(?!<br>).)+", re.DOTALL)
"""A line of a map tip, or its end; an expression may hold one, too."""
_EXPRESSION: Final = re.compile(r"\[%.*?%\]", re.DOTALL)
_EXTREME: Final = re.compile(r'(?:minimum|maximum)\((?:&quot;|")(\w+)(?:&quot;|")(?:, (?:&quot;|")tool(?:&quot;|"))?\)')
"""Aggregates of QGIS in a style."""
DOCTYPE: Final = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
"""First line of styles and projects of QGIS."""
_QUOTED_TEXT: Final = re.compile(r"'([^']*)'")
_FIELD: Final = re.compile(f'"({"|".join(VALUES)})"')
_FORMATTED: Final = re.compile(r'format_date\("(start|end|time)",')


def with_words(
    style: str,
    fields: Sequence[str],
    language: str,
    *,
    report: bool,
    aliases: Mapping[str, str] = COLUMN_LABELS,
    values: Mapping[str, Mapping[str, str]] = VALUES,
) -> str:
    """A style of QGIS with aliases, widgets and actions for the fields of a layer; `report`: `report.html` is there."""
    known = [(number, name) for number, name in enumerate(fields) if name in aliases]
    widgets = "".join(_widget(name, language, values.get(name)) for _, name in known)
    named = "".join(
        f'<alias index="{number}" field="{name}" name="{escape(_known(aliases[name], language))}"/>'
        for number, name in known
    )
    actions = _actions(language) if report else ""
    more = f"<fieldConfiguration>{widgets}</fieldConfiguration><aliases>{named}</aliases>{actions}"
    return style.replace('styleCategories="', f'styleCategories="{_CATEGORIES}|', 1).replace(
        "</qgis>", f"{more}</qgis>"
    )


def _widget(name: str, language: str, words: Mapping[str, str] | None) -> str:
    if words is not None:
        pairs = "".join(
            f'<Option type="Map"><Option name="{escape(_known(word, language))}" value="{value}" type="QString"/>'
            "</Option>"
            for value, word in words.items()
        )
        return _configured(name, "ValueMap", f'<Option name="map" type="List">{pairs}</Option>')
    digits = _DECIMALS.get(name.rpartition("_")[2])
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
    report = Text("Open report").in_language(language)
    folder = Text("Open folder").in_language(language)
    url = f"'file://' || if(left({_FOLDER}, 1) = '/', '', '/') || {_FOLDER}"
    return "<attributeactions>{}</attributeactions>".format(
        "".join(
            f'<actionsetting type="{_OPEN_URL}" name="{escape(name)}" shortTitle="{escape(name)}" id="{{{key}}}" '
            f'action="{escape(f"[% {target} %]")}" capture="0" isEnabledOnlyWhenEditable="0" icon="" '
            'notificationMessage=""><actionScope id="Feature"/><actionScope id="Layer"/><actionScope id="Canvas"/>'
            "</actionsetting>"
            for key, name, target in (
                ("6e1ce9d8-3f57-4c1b-9a58-0c1a4f6f2a01", report, f"{url} || 'report.html'"),
                ("6e1ce9d8-3f57-4c1b-9a58-0c1a4f6f2a02", folder, url),
            )
        )
    )


def finished_style(
    style: str, language: str, clocks: Sequence["StyleClock"], extremes: Mapping[str, str], *, tools: bool = False
) -> str:
    """A packaged style in a language, with local times if there are clocks, and with names of several tools.

    `extremes` are those of :func:`field_extremes`: numbers in place of `minimum("pass")` and its like. QGIS computes
    these while it draws, in threads that use the project, and crashes where it changes meanwhile (3.40, seen with gdb).
    """
    style = in_language(style, language)
    style = in_local_times(style, clocks) if clocks else style
    style = naming_tools(style) if tools else style
    return _EXTREME.sub(lambda found: escape(extremes[unescape(found[0])], quote=True), style)


def extreme_fields(style: str) -> list[str]:
    """The fields whose least or greatest values a packaged style needs."""
    return sorted({found[1] for found in _EXTREME.finditer(style)})


def field_extremes(columns: Mapping[str, NDArray[Any]]) -> dict[str, str]:
    """Expressions for the least and greatest values of the numbers in columns, by QGIS's aggregates for them.

    With a column `tool` also those of each tool.

    >>> field_extremes({"pass": np.array([1, 2, 5])})
    {'minimum("pass")': '1', 'maximum("pass")': '5'}
    """
    found = {}
    tool = columns.get("tool")
    for name, column in columns.items():
        if np.ma.getdata(column).dtype.kind not in "iuf":
            continue
        values = np.ma.filled(np.ma.asarray(column, dtype=np.float64), np.nan)
        for aggregate, extreme in (("minimum", np.min), ("maximum", np.max)):
            found[f'{aggregate}("{name}")'] = _extreme(values, extreme)
            if tool is not None:
                known = ", ".join(
                    f"{_quoted(one)}, {_extreme(values[tool == one], extreme)}" for one in dict.fromkeys(tool.tolist())
                )
                found[f'{aggregate}("{name}", "tool")'] = f'map_get(map({known}), "tool")'
    return found


def _extreme(values: FloatArray, extreme: Callable[[FloatArray], Any]) -> str:
    known = values[np.isfinite(values)]
    return f"{extreme(known):.9g}" if len(known) else "NULL"


def _quoted(text: object) -> str:
    return "'" + str(text).replace("\\", "\\\\").replace("'", "''") + "'"


def in_language(style: str, language: str) -> str:
    """A packaged style (QML) in another language; what the catalogue does not know stays English.

    Each line of a map tip is a text of the catalogue, with {1}, {2}, … for its expressions.
    """
    if language == ENGLISH:
        return style
    root = ET.fromstring(style)  # noqa: S314 (a file of this package)
    for tag in _LABELLED_TAGS:
        for one in root.iter(tag):
            if one.get("label"):
                label = str(one.get("label"))
                one.set("label", texts_of(language).get(label) or in_marks(label, language))
    for tip in root.iter("mapTip"):
        tip.text = _LINE.sub(lambda line: _line(line[0], language), tip.text or "")
    return DOCTYPE + ET.tostring(root, encoding="unicode") + "\n"


def naming_tools(style: str) -> str:
    """A style whose labels and map tips name the tool (field `tool`), which has passes of its own from 1 on.

    For layers of several tools; colours by the number of a pass are those of the passes of one tool, too.
    """
    label = """fieldName="&quot;tool&quot; || ' ' || &quot;pass&quot;"\\1isExpression="1\""""
    style = re.sub('fieldName="pass"([^>]*)isExpression="0"', label, style)
    style = re.sub(r"(minimum|maximum)\(&quot;pass&quot;\)", r"\1(&quot;pass&quot;, &quot;tool&quot;)", style)
    return re.sub(r"(<mapTip[^>]*>)(?!<)", r'\1[% "tool" %]: ', style)


def write_raster_style(raster: Path, style: str) -> None:
    """Write a packaged style beside a raster, in the language of the user; QGIS loads it with the raster."""
    raster.with_name(style_of(raster.name)).write_text(
        in_language(packaged_style(style), language_of_user()), encoding="utf-8"
    )


def tip_line(line: str) -> tuple[str, list[str]]:
    """A line of a map tip as a text of the catalogue, and its expressions."""
    expressions = _EXPRESSION.findall(line)
    for number, expression in enumerate(expressions, 1):
        line = line.replace(expression, f"{{{number}}}", 1)
    return line, expressions


def _line(line: str, language: str) -> str:
    text, expressions = tip_line(line)
    told = [_expression(one, language) for one in expressions]
    return re.sub(r"\{(\d+)\}", lambda hole: told[int(hole[1]) - 1], _known(text, language))


def _expression(expression: str, language: str) -> str:
    """An expression with its texts, and the values of fields that have words, in a language."""

    def worded(found: re.Match[str]) -> str:
        pairs = ", ".join(f"'{value}', '{_known(word, language)}'" for value, word in VALUES[found[1]].items())
        return f"""coalesce(map_get(map({pairs}), "{found[1]}"), "{found[1]}")"""

    return _FIELD.sub(worded, _QUOTED_TEXT.sub(lambda found: f"'{_known(found[1], language)}'", expression))


def _known(text: str, language: str) -> str:
    return texts_of(language).get(text, text)


@dataclass(frozen=True)
class StyleClock:
    """The clocks of a place from one UTC to another, of these sessions (field `session` of their features)."""

    zone: ZoneInfo
    first_s: float
    last_s: float
    sessions: tuple[str, ...] = ()


def in_local_times(style: str, clocks: Sequence[StyleClock]) -> str:
    """A style whose map tips show the local time of a zone, which they name, instead of UTC.

    `format_date` in its map tips formats the fields `start`, `end` and `time`. Where sessions have clocks of different
    zones, each feature shows that of its session, and of the first one if none names it.
    """
    usual, *others = clocks

    def of_session(values: Sequence[str], usual_value: str) -> str:
        if not others:
            return usual_value
        cases = ""
        for clock, value in zip(others, values, strict=True):
            sessions = "', '".join(clock.sessions)
            cases += f""" WHEN "session" IN ('{sessions}') THEN {value}"""
        return f"(CASE{cases} ELSE {usual_value} END)"

    def shifted(found: re.Match[str]) -> str:
        field = found[1]
        shift = of_session([_shift(clock, field) for clock in others], _shift(usual, field))
        return f'format_date("{field}" + {shift},'

    names = of_session([f"'{clock.zone.key}'" for clock in others], f"'{usual.zone.key}'")
    name = f"[% {names} %]" if others else usual.zone.key
    return _FORMATTED.sub(shifted, style).replace(" UTC", f" ({name})")


def _shift(clock: StyleClock, field: str) -> str:
    """Expression of QGIS: what a clock is ahead of the UTC in a field."""
    shift = f"to_interval('{offset_at(clock.zone, clock.first_s)} seconds')"
    changes = offset_changes(clock.zone, clock.first_s, clock.last_s)
    if not changes:
        return shift
    # The last change before a time is the one that counts, so the latest stands first.
    cases = "".join(
        f" WHEN epoch(\"{field}\") &gt;= {1000.0 * at_s:.0f} THEN to_interval('{after_s} seconds')"
        for at_s, after_s in reversed(changes)
    )
    return f"(CASE{cases} ELSE {shift} END)"


def offset_at(zone: ZoneInfo, t_s: float) -> int:
    """Seconds by which the clocks of a zone are ahead of UTC."""
    offset = local_time(t_s, zone).utcoffset() or dt.timedelta(0)
    return round(offset.total_seconds())


def offset_changes(zone: ZoneInfo, first_s: float, last_s: float) -> list[tuple[int, int]]:
    """Changes of a zone's offset within a span: (UTC of the change, seconds ahead of UTC from then on)."""
    changes = []
    day = first_s
    offset = offset_at(zone, first_s)
    while day < last_s:
        later = min(day + 86_400.0, last_s)
        if (after := offset_at(zone, later)) != offset:
            low = int(day)
            high = int(later) + 1
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (middle, high) if offset_at(zone, middle) == offset else (low, middle)
            changes.append((high, after))
            offset = after
        day = later
    return changes
