# SPDX-License-Identifier: GPL-2.0-or-later
"""Previews of sessions as layers: trajectory and coarse surface, in a group that the products of the run replace."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from qgis.core import Qgis, QgsMapLayer, QgsProject, QgsRasterLayer
from qgis.PyQt.QtCore import QCoreApplication

from .figures import MOST
from .own_layers import emptied_group, groups_with, mark, only_own, own_vector, take_out
from .products import read_object
from .styles import load_style_of_language, show_as_surface
from .translation import in_marks

tr = partial(QCoreApplication.translate, "Previews")

ACCOUNT = "preview.json"
TRACK_FILE = "preview_track.gpkg"
SURFACE_FILE = "preview_dsm.tif"
PREVIEW_PROPERTY = "furrowmap/preview"
"""Property of a group in the layer tree: the :func:`session_key` of the session."""


def open_preview(folder: str | Path, project: QgsProject | None = None) -> list[QgsMapLayer]:
    """Open a preview as topmost group, in place of an earlier one of its session; its layers, none if none opens."""
    project = QgsProject.instance() if project is None else project
    account = read_account(folder)
    layers = [layer for layer in _read_layers(Path(folder)) if layer.isValid()]
    if not layers:
        return []
    if only_own(project):
        project.setCrs(layers[0].crs())
    name = (account.get("session") or {}).get("name") or Path(folder).name
    title = tr("Preview: {name}").format(name=name)
    group, place = emptied_group(project, PREVIEW_PROPERTY, session_key(account) or str(folder), title)
    for number, layer in enumerate(layers):
        project.addMapLayer(layer, addToLegend=False)
        node = group.insertLayer(place + number, layer)
        node.setExpanded(False)
    return layers


def remove_previews(project: QgsProject, account: dict[str, Any]) -> None:
    """Remove the previews of a session, of which `account` is the `preview.json` or `report.json`, from a project."""
    key = session_key(account)
    for group in groups_with(project, PREVIEW_PROPERTY, key) if key else []:
        take_out(project, group)


def session_key(account: dict[str, Any]) -> str:
    """Identifies the recordings of a preview or a run by the names and sizes of the files; "" for none."""
    session = account.get("session") or {}
    recording = session.get("recording") or {}
    named = [name for kind in ("lidar", "gnss") for name in recording.get(kind) or []]
    files = sorted(
        [file.get("name"), file.get("bytes")]
        for file in account.get("inputs") or []
        if any(file.get("name") == name or str(file.get("name")).startswith(f"{name}/") for name in named)
    )
    return json.dumps(files) if files else ""


def read_account(folder: str | Path) -> dict[str, Any]:
    """The content of `preview.json`; empty if it cannot be read."""
    return read_object(Path(folder) / ACCOUNT)


def preview_text(account: dict[str, Any]) -> str:
    """A preview in one line: path length, duration, share of RTK fixes."""
    figures = account.get("figures") or {}
    used = (account.get("positions") or {}).get("used") or {}
    distance = figures.get("distance_m", 0.0)
    duration = figures.get("duration_s", 0.0)
    if not (abs(distance) < MOST and abs(duration) < MOST):
        return str(tr("the times or positions are damaged"))
    text = in_marks(tr("{distance:,.0f} m in {time:,.0f} s").format(distance=distance, time=duration))
    count = sum(used.values())
    if count:
        text += "; " + tr("{share:.0%} RTK fixed").format(share=used.get("fixed", 0) / count)
    return text


def _read_layers(folder: Path) -> Iterator[QgsMapLayer]:
    track = own_vector(f"{folder / TRACK_FILE}|layername=trajectory", Path(TRACK_FILE).stem, tr("trajectory"))
    if track.isValid():
        track.loadDefaultStyle()
        load_style_of_language(track)
        track.elevationProperties().setClamping(Qgis.AltitudeClamping.Absolute)
    yield track
    if (folder / SURFACE_FILE).is_file():
        surface = QgsRasterLayer(str(folder / SURFACE_FILE), tr("coarse surface"), "gdal")
        if surface.isValid():
            mark(surface, Path(SURFACE_FILE).stem)
            show_as_surface(surface, styled=True)
        yield surface
