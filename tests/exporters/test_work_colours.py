"""One set of colours for ground worked: on the live page, in reports, on maps, in QGIS, QField and shared pages."""

from __future__ import annotations

import re
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.exporters import work_colours
from furrowmap.exporters.files.result_folder import packaged_style
from furrowmap.exporters.reports.drawings import pass_colour
from furrowmap.exporters.reports.html_pages import render
from furrowmap.exporters.share.symbols import layer_style
from furrowmap.exporters.work_colours import DAY, NIGHT

CONTRAST = 3.0
"""WCAG 2.2, criteria 1.4.3 (large text) and 1.4.11 (symbols)."""
APART = 20.0
"""In CIELAB, between two states of ground: several times what is just told apart side by side."""
TEXTS = [
    *((name, "paper") for name in ("ink", "soft", "worked", "overlap", "missed", "not-seen", "alarm-text")),
    ("alarm-ink", "alarm"), ("note-ink", "note"), ("on-tool", "tool-down"),
]  # fmt: skip
SYMBOLS = [
    *((name, "ground") for name in ("worked", "overlap", "missed", "not-seen", "vehicle", "boundary", "tool-down")),
    ("line", "paper"), ("vehicle", "paper"), ("tool-up", "paper"),
]  # fmt: skip
LACKS = {
    "none": np.eye(3),
    "red": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "green": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]),
    "blue": np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]]),
}
"""What is left without one kind of cones (Machado, Oliveira and Fernandes 2009), of linear RGB."""


def linear(colour: str) -> NDArray[np.float64]:
    """Linear RGB of a colour of sRGB (IEC 61966-2-1)."""
    value = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def contrast(one: str, other: str) -> float:
    """Contrast ratio (WCAG 2.2)."""
    dark, light = sorted(float(linear(colour) @ [0.2126, 0.7152, 0.0722]) for colour in (one, other))
    return (light + 0.05) / (dark + 0.05)


def lab(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIELAB of linear RGB, with the white of D65."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    part = to_xyz @ np.clip(rgb, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    x, y, z = np.where(part > 0.008856, np.cbrt(part), 7.787 * part + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("light", [DAY, NIGHT], ids=["day", "night"])
def test_texts_and_symbols__are_seen_and_told_apart_by_all(light: dict[str, str]) -> None:
    low = {pair: contrast(light[pair[0]], light[pair[1]]) for pair in TEXTS + SYMBOLS}
    assert {pair: ratio for pair, ratio in low.items() if ratio < CONTRAST} == {}
    for lack, matrix in LACKS.items():
        for one, other in combinations(("worked", "overlap", "missed", "not-seen"), 2):
            apart = float(np.linalg.norm(lab(matrix @ linear(light[one])) - lab(matrix @ linear(light[other]))))
            assert apart > APART, (lack, one, other)


@pytest.mark.parametrize("light", [DAY, NIGHT], ids=["day", "night"])
def test_tool__is_told_from_ground_and_has_another_hue_than_overlap(light: dict[str, str]) -> None:
    for matrix in LACKS.values():
        tool = lab(matrix @ linear(light["tool-down"]))
        others = [lab(matrix @ linear(light[name])) for name in ("worked", "overlap", "missed", "not-seen")]
        assert min(float(np.linalg.norm(tool - other)) for other in others) > APART
    hues = [np.degrees(np.arctan2(*lab(linear(light[name]))[[2, 1]])) for name in ("tool-down", "overlap")]
    assert abs((hues[0] - hues[1] + 180.0) % 360.0 - 180.0) > 90.0


def drawn(layer: str, option: str = "color") -> set[str]:
    """The colours of a layer in QGIS and QField, without their opacity."""
    root = ET.fromstring(packaged_style(f"{layer}.qml"))
    values = [str(one.get("value")).split(",") for one in root.iter("Option") if one.get("name") == option]
    return {"#" + "".join(f"{int(part):02x}" for part in value[:3]) for value in values}


def test_colours__are_the_same_in_qgis_and_on_the_pages() -> None:
    assert drawn("overlaps") == {work_colours.OVERLAP_COLOUR}
    plugin = (Path(__file__).resolve().parents[2] / "plugin" / "styles.py").read_text(encoding="utf-8")
    rgb = [int(work_colours.WORKED_COLOUR[at : at + 2], 16) for at in (1, 3, 5)]
    assert f'WORKED_GROUND = "{",".join(map(str, rgb))},255"' in plugin
    drawing = (Path(__file__).resolve().parents[2] / "plugin" / "dock" / "vehicle_view.py").read_text(encoding="utf-8")
    assert f'IMPLEMENT_COLOUR = QColor("{work_colours.TOOL_DOWN_COLOUR}")' in drawing
    assert drawn("misses") == {work_colours.MISSED_COLOUR}
    assert drawn("coverage", "outline_color") == {work_colours.WORKED_COLOUR}
    assert drawn("boundary", "outline_color") == {work_colours.BOUNDARY_COLOUR}
    assert drawn("passes") == set(work_colours.PASS_RAMP)
    assert {work_colours.TOOL_DOWN_COLOUR, work_colours.TOOL_UP_COLOUR, work_colours.TOOL_UNKNOWN_COLOUR} == drawn(
        "tool_path", "line_color"
    )
    assert {work_colours.TOOL_DOWN_COLOUR, work_colours.TOOL_UP_COLOUR} < drawn("events")
    assert work_colours.TOOL_DOWN_COLOUR in drawn("gnss_tracks", "line_color")  # the reference, as in evaluation.html
    ramp = re.search(r"create_ramp\(map\(0, '(.*?)', 0.5, '(.*?)', 1, '(.*?)'\)\)", packaged_style("passes.qml"))
    assert ramp is not None
    assert ramp.groups() == work_colours.PASS_RAMP
    assert tuple(pass_colour(number, 3) for number in (1, 2, 3)) == work_colours.PASS_RAMP
    fill = re.findall(r"[\d.]+", str(layer_style("coverage", {}).default.fill))
    assert [int(part) for part in fill[:3]] == rgb  # filled, as the plugin fills it
    assert float(fill[3]) == pytest.approx(float(str(re.findall(r"WORKED_OPACITY = ([\d.]+)", plugin)[0])), abs=0.01)
    for name in ("overlaps", "misses"):  # as a shared page draws them
        style = layer_style(name, {})
        fills = {symbol.fill for symbol in (style.default, *style.by_value.values())}
        parts = {tuple(int(value) for value in re.findall(r"\d+", str(fill))[:3]) for fill in fills}
        colour = {"overlaps": work_colours.OVERLAP_COLOUR, "misses": work_colours.MISSED_COLOUR}[name]
        assert parts == {tuple(int(colour[at : at + 2], 16) for at in (1, 3, 5))}


def test_report__takes_them_from_the_one_file() -> None:
    """Its style sheet, and the keys of its maps."""
    folder = files("furrowmap.exporters.reports.templates")
    sheet = folder.joinpath("base.html").read_text(encoding="utf-8")
    for rule, name in (("overlap", "OVERLAP"), ("miss", "MISSED"), ("tool.down", "TOOL_DOWN"), ("tool.up", "TOOL_UP")):
        assert re.search(
            rf"svg \.{re.escape(rule)} {{ (?:fill|stroke): {{{{ work_colours\.{name}_COLOUR }}}}", sheet
        ), rule
    keys = folder.joinpath("report.html").read_text(encoding="utf-8")
    assert set(re.findall(r"\(work_colours\.(\w+)_COLOUR, _", keys)) == {"OVERLAP", "MISSED", "TOOL_DOWN", "TOOL_UP"}


@pytest.mark.parametrize("name", ["report.html", "evaluation.html"])
def test_words__name_no_colour_of_another_set(name: str) -> None:
    page = files("furrowmap.exporters.reports.templates").joinpath(name).read_text(encoding="utf-8")
    assert re.findall(r"\bbrown\b", page, re.IGNORECASE) == []


def test_live_page__has_them_by_day_and_night() -> None:
    for language in LANGUAGES:
        page = render("live.html", language=language, day=DAY, night=NIGHT)
        by_day, by_night = (
            dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6});", page.partition(f"{rule} {{ ")[2].partition("}")[0]))
            for rule in (":root", "[data-night]")
        )
        assert (by_day, by_night) == (DAY, NIGHT)
    assert [DAY[name] for name in ("worked", "overlap", "missed", "tool-down", "tool-up", "boundary")] == [
        work_colours.WORKED_COLOUR, work_colours.OVERLAP_COLOUR, work_colours.MISSED_COLOUR,
        work_colours.TOOL_DOWN_COLOUR, work_colours.TOOL_UP_COLOUR, work_colours.BOUNDARY_COLOUR,
    ]  # fmt: skip
