"""Runs inside the desktop QGIS (scripts/qgis_desktop.sh): does with the plugin's widgets what a user does.

Arguments: folder with a drive's recordings, folder of an earlier run, folder with a flight's recordings, the worker's
command, folder for what it writes.
Each step is a part of one long story; what was seen is printed at its end as one line of JSON.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import qgis.utils
from qgis import processing
from qgis.core import (
    Qgis,
    QgsApplication,
    QgsFeedback,
    QgsLayoutExporter,
    QgsLocatorContext,
    QgsProject,
    QgsSettings,
)
from qgis.PyQt.QtCore import QEvent, QMimeData, QPoint, QPointF, Qt, QTimer, QUrl
from qgis.PyQt.QtGui import QColor, QDragEnterEvent, QDropEvent, QPalette
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QApplication, QGroupBox, QPushButton, QWidget

RECORDINGS, EARLIER, FLIGHT, WORKER, OUT = arguments  # noqa: F821 - given by qgis_desktop.sh
WINDOW = iface.mainWindow()  # noqa: F821
LONGEST_S = 400.0
DARK_WINDOW = "#323232"
"""The window of the theme Night Mapping."""
MOUNTING = {
    "furrowmapAntenna": (1.847, -0.052, 1.624),
    "furrowmapLidar": (-0.632, 0.041, 2.416),
    "furrowmapLidarTurn": (0.8, 40.6, 179.3),
    "furrowmapImplementXy": (-1.62, 0.0),
}
MACHINES = Path(OUT) / "machines"
os.environ["FURROWMAP_MACHINES"] = str(MACHINES)
CAPABILITIES = """<?xml version="1.0" encoding="UTF-8"?>
<WMS_Capabilities version="1.3.0" xmlns="http://www.opengis.net/wms" xmlns:xlink="http://www.w3.org/1999/xlink">
<Service><Name>WMS</Name><Title>Land registry</Title><OnlineResource xlink:href="http://127.0.0.1:PORT/wms"/></Service>
<Capability><Request>
<GetCapabilities><Format>text/xml</Format><DCPType><HTTP><Get>
<OnlineResource xlink:href="http://127.0.0.1:PORT/wms?"/></Get></HTTP></DCPType></GetCapabilities>
<GetMap><Format>image/png</Format><DCPType><HTTP><Get>
<OnlineResource xlink:href="http://127.0.0.1:PORT/wms?"/></Get></HTTP></DCPType></GetMap></Request>
<Exception><Format>XML</Format></Exception>
<Layer><Title>All</Title><CRS>EPSG:3857</CRS>
<EX_GeographicBoundingBox><westBoundLongitude>139</westBoundLongitude><eastBoundLongitude>141</eastBoundLongitude>
<southBoundLatitude>35</southBoundLatitude><northBoundLatitude>37</northBoundLatitude></EX_GeographicBoundingBox>
<BoundingBox CRS="EPSG:3857" minx="15473000" miny="4163000" maxx="15696000" maxy="4439000"/>
<Attribution><Title>Land registry office</Title></Attribution>
<Layer queryable="0"><Name>parcels</Name><Title>Parcels</Title></Layer>
</Layer></Capability></WMS_Capabilities>
"""
SEEN: dict[str, Any] = {}
LOGGED: list[str] = []
BUSY = {"cpu_s": 0.0, "last_s": time.thread_time()}

QgsApplication.messageLog().messageReceived.connect(
    lambda text, tab, level: LOGGED.append(f"{tab}: {text}") if level == Qgis.MessageLevel.Critical else None
)


def plugin() -> Any:
    return qgis.utils.plugins["furrowmap"]


def widget(name: str) -> Any:
    found = plugin().dock.findChild(QWidget, name)
    assert found is not None, name
    return found


def click(name: str) -> None:
    QTest.mouseClick(widget(name), Qt.MouseButton.LeftButton)


def drop(target: QWidget, paths: list[Path]) -> None:
    mime = QMimeData()
    mime.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    held = (Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier)
    QApplication.sendEvent(target, QDragEnterEvent(QPoint(30, 30), Qt.DropAction.CopyAction, mime, *held))
    QApplication.sendEvent(target, QDropEvent(QPointF(30, 30), Qt.DropAction.CopyAction, mime, *held))


def page(name: str) -> Callable[[], bool]:
    return lambda: plugin().dock.pages.currentWidget() is getattr(plugin().dock, name)


def previewed() -> bool:
    return bool(widget("furrowmapPreviewWords").text()) and not plugin().dock.previewer.busy


def drawn() -> bool:
    return not iface.mapCanvas().isDrawing()  # noqa: F821


def workers() -> list[int]:
    """Processes of the worker, whoever started them."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"worker" in words and any(b"furrowmap" in word for word in words):
            found.append(int(folder.name))
    return found


def traces() -> dict[str, Any]:
    """What of the plugin is in QGIS."""
    QgsApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    owned = [child for parent in (WINDOW, iface.mapCanvas()) for child in parent.findChildren(QWidget)]  # noqa: F821
    return {
        "widgets": sorted(w.objectName() for w in owned if w.objectName().startswith("furrowmap")),
        "menus": [a.text() for a in iface.pluginMenu().actions() if "furrowmap" in a.text()],  # noqa: F821
        "provider": QgsApplication.processingRegistry().providerById("furrowmap") is not None,
        "tasks": QgsApplication.taskManager().countActiveTasks(),
    }


def groups() -> dict[str, list[str]]:
    root = QgsProject.instance().layerTreeRoot()
    return {group.name(): [key_of(node.layer()) for node in group.findLayers()] for group in root.findGroups()}


def key_of(layer: Any) -> str:
    """What a layer is, whatever its name."""
    return str(layer.customProperty("furrowmap/key") or layer.name())


def reloads() -> Iterator[Any]:
    SEEN["loaded"], SEEN["unloaded"] = [], []
    for _ in range(5):
        assert qgis.utils.unloadPlugin("furrowmap")
        SEEN["unloaded"].append(traces())
        assert qgis.utils.loadPlugin("furrowmap")
        assert qgis.utils.startPlugin("furrowmap")
        SEEN["loaded"].append(traces())
        yield


def without_worker() -> Iterator[Any]:
    """QGIS alone: results of others open, computing offers the set-up."""
    QgsSettings().setValue("furrowmap/interpreter", "/nowhere/furrowmap")
    plugin().dock.show_start()
    yield
    SEEN["setup_offered"] = widget("furrowmapSetup").isVisible()
    shot(f"{OUT}/start.png")  # noqa: F821
    drop(WINDOW, [Path(EARLIER)])
    yield page("result")
    yield drawn
    SEEN["without_worker"] = groups()
    SEEN["crs"] = QgsProject.instance().crs().authid()
    QgsProject.instance().clear()
    click("furrowmapDo_back")
    drop(plugin().dock, sorted(Path(RECORDINGS).iterdir()))
    yield
    SEEN["refused_without_worker"] = page("start")() and not QgsApplication.taskManager().countActiveTasks()
    QgsSettings().setValue("furrowmap/interpreter", WORKER)
    plugin().dock.show_start()
    yield
    SEEN["setup_offered_with_worker"] = widget("furrowmapSetup").isVisible()


def flight() -> Iterator[Any]:
    """The folder of a flight: a form for what it has; what remedies the failed preview is entered by a button."""
    pictures = Path(OUT) / "pictures"
    pictures.mkdir()
    (pictures / "a.jpg").write_bytes(b"")
    drop(plugin().dock, [pictures])
    yield page("run")
    yield page("start")
    SEEN["refused_drop"] = [widget("furrowmapStartError").isVisible(), widget("furrowmapStartError").text()]
    drop(plugin().dock, [Path(FLIGHT)])
    yield page("session")
    shown = ("furrowmapImuGroup", "furrowmapCameraGroup", "furrowmapParcelsGroup", "furrowmapImplementGroup")
    SEEN["flight"] = {
        "findings": widget("furrowmapFindings").text(),
        "vehicle": widget("furrowmapVehicleKind").currentText(),
        "shown": [name for name in shown if not widget(name).isHidden()],
    }
    yield previewed  # it begins by itself
    for k in range(3):
        widget(f"furrowmapImuTurn{k}").setValue(0.0)
    widget("furrowmapImu0").setValue(-0.039)
    widget("furrowmapCameraGroup").setChecked(False)
    click("furrowmapPreview")
    yield lambda: plugin().dock.previewer.busy
    yield previewed
    SEEN["flight"]["failed"] = [widget("furrowmapPreviewWords").text(), widget("furrowmapRemedy").text()]
    shot(f"{OUT}/flight.png")  # noqa: F821
    click("furrowmapRemedy")
    yield lambda: plugin().dock.previewer.busy
    yield previewed
    SEEN["flight"]["remedied"] = [widget("furrowmapPreviewWords").text(), widget("furrowmapRemedy").isVisible()]
    widget("furrowmapAntennaGroup").setChecked(True)
    widget("furrowmapCameraGroup").setChecked(True)
    widget("furrowmapImageTable").setFilePath(f"{FLIGHT}/images.csv")
    widget("furrowmapCamera_fx").setValue(661.4)
    click("furrowmapRun")  # the camera's other intrinsics are missing
    yield
    SEEN["flight"]["fault"] = widget("furrowmapFindings").text()
    for name, value in (("fy", 661.9), ("cx", 402.7), ("cy", 296.1)):
        widget(f"furrowmapCamera_{name}").setValue(value)
    widget("furrowmapParcels").setFilePath(f"{FLIGHT}/parcels.geojson")
    widget("furrowmapInset0").setValue(1.0)
    click("furrowmapSave")
    yield
    yield drawn
    SEEN["flight"]["saved"] = (Path(FLIGHT) / "session.toml").read_text(encoding="utf-8")
    QgsProject.instance().clear()
    click("furrowmapBack")


def new_session() -> Iterator[Any]:
    """Recordings dropped: the form, with what the worker found out."""
    files = sorted(Path(RECORDINGS).iterdir())
    drop(plugin().dock, [path for path in files if path.suffix != ".geojson"])
    SEEN["page_at_once"] = page("run")()
    yield page("session")
    SEEN["findings"] = widget("furrowmapFindings").text()
    SEEN["proposed_crs"] = widget("furrowmapCrs").crs().authid()
    yield previewed  # it begins by itself
    SEEN["first_look"] = {"words": widget("furrowmapPreviewWords").text(), "groups": groups()}
    SEEN["first_look"]["files"] = sorted(path.name for path in Path(RECORDINGS).iterdir())
    widget("furrowmapName").setText("North field")
    widget("furrowmapAntennaGroup").setChecked(True)
    widget("furrowmapImplementGroup").setChecked(True)
    click("furrowmapRun")  # the tool has no width yet
    yield
    SEEN["fault"] = widget("furrowmapFindings").text()
    SEEN["still_in_form"] = page("session")()
    widget("furrowmapWidth").setValue(1.7)
    click("furrowmapRun")  # neither antenna nor scanner is placed
    yield
    titles = [box.title() for box in plugin().dock.session.findChildren(QGroupBox)]
    SEEN["asked"] = {
        "words": widget("furrowmapErrorText").text(),
        "may_go_on": widget("furrowmapRunAnyway").isVisible(),
        "marked": [title for title in titles if "not filled in" in title],
    }
    shot(f"{OUT}/asked.png")  # noqa: F821
    for name, values in MOUNTING.items():
        for k, value in enumerate(values):
            widget(f"{name}{k}").setValue(value)
    widget("furrowmapKind").setText("rotary tiller")
    widget("furrowmapWidth").setValue(1.7)
    widget("furrowmapDepth").setValue(0.12)
    widget("furrowmapBoundary").setFilePath(f"{RECORDINGS}/boundary.geojson")
    click("furrowmapPreview")
    yield previewed
    yield drawn
    SEEN["preview"] = groups()
    drop(plugin().dock, [Path(plugin().dock.previewer._folders[-1])])  # what `furrowmap run --preview` writes, too
    SEEN["dropped_preview"] = groups()
    shot(f"{OUT}/session.png")  # noqa: F821
    yield from two_tools()


def two_tools() -> Iterator[Any]:
    """A second tool is added, and removed again."""
    path = Path(RECORDINGS) / "session.toml"
    click("furrowmapAddTool")
    widget("furrowmapWidth").setValue(1.5)
    widget("furrowmapImplementXy0").setValue(-2.4)
    click("furrowmapSave")
    yield
    SEEN["two_tools"] = path.read_text(encoding="utf-8")
    SEEN["tools"] = [widget("furrowmapTool").itemText(k) for k in range(widget("furrowmapTool").count())]
    widget("furrowmapImplementGroup").setChecked(False)
    click("furrowmapSave")
    yield
    SEEN["one_tool"] = path.read_text(encoding="utf-8")
    SEEN["first_tool"] = [widget("furrowmapWidth").value(), widget("furrowmapTool").isVisible()]


def machines() -> Iterator[Any]:
    """The places are saved as a machine, come back from the list and by a dropped profile; a capture alone says so."""
    widget("furrowmapMachine").setEditText("Tractor 1")
    click("furrowmapSaveMachine")
    yield page("run")
    yield page("session")
    SEEN["machines"] = sorted(path.name for path in MACHINES.iterdir())
    SEEN["machine_shown"] = widget("furrowmapMachine").currentText()
    widget("furrowmapWidth").setValue(1.75)
    click("furrowmapSaveMachine")
    yield page("run")
    yield page("session")
    SEEN["machine_known"] = [widget("furrowmapErrorText").text(), widget("furrowmapReplaceMachine").isVisible()]
    click("furrowmapReplaceMachine")
    yield page("run")
    yield page("session")
    SEEN["machine_replaced"] = "width_m = 1.75" in (MACHINES / "Tractor 1.toml").read_text(encoding="utf-8")
    widget("furrowmapMachine").setEditText("Tractor 9")
    click("furrowmapCalibrate")
    yield
    SEEN["unknown_machine"] = widget("furrowmapFindings").text()
    alone = Path(OUT) / "alone"
    alone.mkdir()
    shutil.copyfile(f"{RECORDINGS}/gnss.nmea", alone / "gnss.nmea")
    drop(plugin().dock, [alone])
    yield page("run")
    yield page("session")
    SEEN["alone"] = {"recordings": widget("furrowmapRecordings").text(), "session": str(plugin().dock.session.path)}
    click("furrowmapRun")
    yield
    SEEN["alone"]["fault"] = widget("furrowmapFindings").text()
    shot(f"{OUT}/alone.png")  # noqa: F821
    with (MACHINES / "Tractor 1.toml").open("a", encoding="utf-8") as profile:  # its last table is the implement
        profile.write('learned = "Tractor 1.npz"\n')
    (MACHINES / "Tractor 1.npz").write_bytes(b"learned")
    box = widget("furrowmapMachine")
    box.setCurrentIndex(box.findText("Tractor 1"))
    box.activated.emit(box.currentIndex())
    SEEN["chosen"] = [widget(f"furrowmapAntenna{k}").value() for k in range(3)]
    shutil.copyfile(f"{RECORDINGS}/recording.pcap.gz", alone / "recording.pcap.gz")
    drop(plugin().dock, [alone / "recording.pcap.gz"])
    yield page("run")
    yield page("session")
    SEEN["completed"] = widget("furrowmapRecordings").text()
    SEEN["kept"] = [widget(f"furrowmapLidarTurn{k}").value() for k in range(3)]
    click("furrowmapSave")
    yield
    SEEN["learned"] = [(alone / "session.toml").read_text(encoding="utf-8"), (alone / "Tractor 1.npz").read_text()]
    (MACHINES / "Tractor 1.npz").unlink()
    profile = Path(OUT) / "passed on.toml"
    shutil.copyfile(MACHINES / "Tractor 1.toml", profile)
    drop(plugin().dock, [profile])
    SEEN["machines_after_drop"] = sorted(path.name for path in MACHINES.iterdir())
    drop(plugin().dock, [Path(RECORDINGS) / "session.toml"])
    yield page("session")


def many_drives() -> Iterator[Any]:
    """Three drives dropped together: one runs, one lacks a recording, one is broken."""
    many = Path(OUT) / "many"
    for name in ("broken", "incomplete", "positions"):
        (many / name).mkdir(parents=True)
    (many / "broken" / "session.toml").write_text("furrowmap = 1\n[recoding]\n")
    for name in ("incomplete", "positions"):
        shutil.copyfile(f"{RECORDINGS}/gnss.nmea", many / name / "gnss.nmea")
    (many / "positions" / "states.csv").write_text("time,state\n2026-06-11T01:23:50Z,down\n2026-06-11T01:24:20Z,up\n")
    (many / "positions" / "session.toml").write_text(
        'furrowmap = 1\nname = "positions"\n[recording]\ngnss = ["gnss.nmea"]\n[crs]\nmap = "EPSG:6677"\n'
        '[implement]\nwidth_m = 1.7\nxy_m = [-1.62, 0.0]\nstates = ["states.csv"]\n'
    )
    drop(plugin().dock, sorted(many.iterdir()))
    rows = widget("furrowmapBatch")
    SEEN["waiting"] = rows.item(2).text()
    yield lambda: not plugin().dock.batch.busy
    SEEN["drives"] = [rows.item(k).text() for k in range(rows.count())]
    computed_ns = (many / "positions" / "session_result" / "report.json").stat().st_mtime_ns
    shot(f"{OUT}/drives.png")  # noqa: F821
    rows.itemActivated.emit(rows.item(1))
    SEEN["incomplete"] = [page("session")(), widget("furrowmapRecordings").text()]
    plugin().dock.pages.setCurrentWidget(plugin().dock.drives)
    rows.itemActivated.emit(rows.item(2))
    yield page("result")
    yield from passed_on()
    click("furrowmapDo_back")
    SEEN["back_in_list"] = page("drives")()
    assert qgis.utils.unloadPlugin("furrowmap")
    assert qgis.utils.loadPlugin("furrowmap")
    assert qgis.utils.startPlugin("furrowmap")
    plugin().dock.show()
    click("furrowmapDrives")
    rows = widget("furrowmapBatch")
    SEEN["drives_after_restart"] = [rows.item(k).text() for k in range(rows.count())]
    drop(plugin().dock, sorted(many.iterdir()))
    yield lambda: not plugin().dock.batch.busy
    report = many / "positions" / "session_result" / "report.json"
    SEEN["drives_again"] = [rows.item(k).text() for k in range(rows.count())]
    SEEN["computed_again"] = report.stat().st_mtime_ns != computed_ns
    QgsProject.instance().clear()
    plugin().dock.open_session(Path(RECORDINGS) / "session.toml")
    yield page("session")


def passed_on() -> Iterator[Any]:
    """The result that is open: exported, and added to a farm map; the names are those that the file dialogs give."""
    farm, web, dock = Path(OUT) / "farm.gpkg", Path(OUT) / "web", plugin().dock
    formats = widget("furrowmapExport").menu().actions()
    SEEN["formats"] = [action.data() for action in formats if action.data()]
    SEEN["not_offered"] = [action.data() for action in formats if not action.isEnabled()]
    SEEN["format_words"] = [action.text() for action in formats if action.text() == action.data()]
    shot(f"{OUT}/small.png")  # noqa: F821
    dock.export("geojson", str(web))
    yield page("run")
    yield page("result")
    SEEN["exported"] = sorted(path.name for path in web.iterdir())
    dock.add_to_farm([dock._folder], str(farm))
    yield page("run")
    yield page("result")
    SEEN["farm"] = [QgsSettings().value("furrowmap/farmMap") == str(farm), groups()["farm"]]
    dialog = processing.createAlgorithmDialog("furrowmap:farm_history", {"FARM_MAP": str(farm)})
    dialog.show()
    yield
    box = dialog.findChild(QWidget, "furrowmapFields")
    SEEN["fields"] = [box.itemText(number) for number in range(box.count())]
    SEEN["field"] = dialog.mainWidget().createProcessingParameters()["FIELD"]
    shot(f"{OUT}/history.png")  # noqa: F821
    dialog.close()


def refused_run() -> Iterator[Any]:
    """The folder holds the products of another recording: kept, or replaced by the whole run below."""
    folder = Path(RECORDINGS) / "session_result"
    folder.mkdir()
    (folder / "report.json").write_text("{}")
    click("furrowmapRun")
    yield page("run")
    yield page("session")
    SEEN["refusal"] = widget("furrowmapErrorText").text()
    SEEN["choice"] = [widget(name).isVisible() for name in ("furrowmapReplace", "furrowmapKeepBoth")]
    shot(f"{OUT}/refused.png")  # noqa: F821
    click("furrowmapKeepBoth")
    yield lambda: widget("furrowmapStages").count() >= 2
    SEEN["kept_both"] = [path.name for path in sorted(Path(RECORDINGS).glob("session_result*"))]
    click("furrowmapCancel")
    yield lambda: not QgsApplication.taskManager().countActiveTasks()
    yield lambda: not (Path(RECORDINGS) / "session_result-2").exists()


def cancelled_run() -> Iterator[Any]:
    """A run that is cancelled in its midst acts at once and leaves nothing."""
    before = sorted(path.name for path in Path(RECORDINGS).iterdir())
    click("furrowmapRun")
    stages = widget("furrowmapStages")
    yield lambda: stages.count() >= 2
    SEEN["workers_at_work"] = len(workers())
    begun = time.monotonic()
    click("furrowmapCancel")
    yield page("session")
    SEEN["cancel_s"] = time.monotonic() - begun
    yield lambda: not QgsApplication.taskManager().countActiveTasks()
    SEEN["workers_after_cancel"] = workers()
    SEEN["left_by_cancel"] = [p.name for p in sorted(Path(RECORDINGS).iterdir()) if p.name not in before]


def whole_run() -> Iterator[Any]:
    """From the form to the map, in place of the products of another recording."""
    click("furrowmapRun")
    yield page("run")
    yield page("session")
    click("furrowmapReplace")
    stages = widget("furrowmapStages")
    bar = widget("furrowmapProgress")
    SEEN["percent"] = []
    bar.valueChanged.connect(SEEN["percent"].append)
    yield lambda: stages.count() >= 2 and bar.maximum() == 100
    shot(f"{OUT}/run.png")  # noqa: F821
    yield page("result")
    SEEN["stages"] = [stages.item(k).text() for k in range(stages.count())]
    yield drawn
    SEEN["workers_after_run"] = workers()
    SEEN["groups"] = groups()
    SEEN["figures"] = widget("furrowmapFigures").toPlainText()
    SEEN["invalid"] = [layer.name() for layer in QgsProject.instance().mapLayers().values() if not layer.isValid()]
    layers = list(QgsProject.instance().mapLayers().values())
    SEEN["styles"] = {key_of(layer): layer.renderer().type() for layer in layers}
    SEEN["map_tips"] = [key_of(layer) for layer in layers if getattr(layer, "mapTipTemplate", str)()]
    span = QgsProject.instance().timeSettings().temporalRange()
    SEEN["span"] = [span.begin().toString(Qt.DateFormat.ISODate), span.end().toString(Qt.DateFormat.ISODate)]
    SEEN["terrain"] = QgsProject.instance().elevationProperties().terrainProvider().type()
    SEEN["busy_s"] = BUSY["cpu_s"]
    tree, model = QgsProject.instance().layerTreeRoot(), iface.layerTreeView().layerTreeModel()  # noqa: F821
    changed = next(node for node in tree.findLayers() if key_of(node.layer()) == "change")
    SEEN["legend"] = model.layerLegendNodes(changed)[0].data(Qt.ItemDataRole.DisplayRole)
    shot(f"{OUT}/result.png")  # noqa: F821
    box = widget("furrowmapTheme")
    SEEN["themes"] = {}
    for number in (*range(box.count()), 0):
        box.setCurrentIndex(number)
        box.activated.emit(number)
        SEEN["themes"][box.itemData(number)] = [key_of(n.layer()) for n in tree.findLayers() if n.isVisible()]
        yield drawn


def on_the_map() -> Iterator[Any]:
    """Locator, pages to print, replay, base map, the same results again."""
    from furrowmap.basemap import base_map_layers, base_maps, known_layer, show_base_map
    from furrowmap.dock.replay import las_time_s, tools_of, worked_strips
    from furrowmap.results import groups_of, read_report
    from furrowmap.session_layout import session_layout

    found: list[Any] = []
    locator = plugin().locator.clone()
    locator.resultFetched.connect(found.append)
    context = QgsLocatorContext()
    locator.prepare("2", context)
    locator.fetchResults("2", context, QgsFeedback())
    SEEN["located"] = [result.displayString for result in found]
    extent = iface.mapCanvas().extent()  # noqa: F821
    plugin().locator.triggerResult(found[0])
    SEEN["zoomed"] = iface.mapCanvas().extent() != extent  # noqa: F821
    yield drawn
    project = QgsProject.instance()
    folder = plugin().dock._folder
    layout = session_layout(project, groups_of(project)[0], read_report(folder))
    settings = QgsLayoutExporter.PdfExportSettings()
    settings.textRenderFormat = Qgis.TextRenderFormat.AlwaysText
    written = [QgsLayoutExporter(layout).exportToPdf(f"{OUT}/page.pdf", settings)]
    layout.atlas().setEnabled(True)
    written.append(QgsLayoutExporter.exportToPdf(layout.atlas(), f"{OUT}/atlas.pdf", settings)[0])
    assert written == [QgsLayoutExporter.ExportResult.Success] * 2, written
    yield
    nodes = {key_of(node.layer()): node for node in project.layerTreeRoot().findLayers()}
    strips = worked_strips(nodes["trajectory"].layer(), tools_of(read_report(folder)), 1.0)
    SEEN["swept_m2"] = sum(strip.geometry().area() for strip in strips)
    before = sorted(project.mapLayers())
    for theme in ("work", "surface"):
        plugin().dock.result.theme_wanted.emit(theme)
        click("furrowmapDo_replay")
        controller = iface.mapCanvas().temporalController()  # noqa: F821
        yield lambda controller=controller: controller.currentFrameNumber() >= 2
        controller.pause()
        yield drawn
        grown = [project.mapLayer(key).type().name for key in sorted(set(project.mapLayers()) - set(before))]
        name = {"work": "coverage", "surface": "change"}[theme]
        SEEN[f"replay_{theme}"] = [sorted(grown), nodes[name].isVisible()]
        time_label = iface.mapCanvas().findChild(QWidget, "furrowmapReplayTime")  # noqa: F821
        SEEN["replay_time"] = time_label.text()
        SEEN["on_dark"] = on_dark(time_label)
        SEEN["replay_end"] = controller.dateTimeRangeForFrameNumber(controller.currentFrameNumber()).end()
        SEEN["replayed"] = controller.totalFrameCount()
        controller.setNavigationMode(controller.NavigationMode.NavigationOff)
        SEEN[f"replay_{theme}"] += [sorted(project.mapLayers()) == before, nodes[name].isVisible()]
    SEEN["replay_end"] = SEEN["replay_end"].toString(Qt.DateFormat.ISODate)
    plugin().dock.result.theme_wanted.emit("work")
    cloud = next(node for node in project.layerTreeRoot().findLayers() if key_of(node.layer()) == "cloud")
    cloud.setItemVisibilityChecked(True)
    click("furrowmapDo_replay")
    yield lambda: controller.currentFrameNumber() >= 2
    controller.pause()
    SEEN["cloud_filter"] = [cloud.layer().subsetString(), las_time_s(controller.dateTimeRangeForFrameNumber(2).end())]
    controller.setNavigationMode(controller.NavigationMode.NavigationOff)
    SEEN["cloud_filter_after"] = cloud.layer().subsetString()
    cloud.setItemVisibilityChecked(False)
    empty, SEEN["base_maps"] = QgsProject(), {}
    for base in base_maps():
        show_base_map(known_layer(base.key), base.key, empty)
        SEEN["base_maps"][base.key] = [base_map_layers(empty)[0].isValid(), len(empty.mapLayers())]
    tiles = QUrl.fromLocalFile(OUT).toString() + "/{z}/{x}/{y}.png"
    box = widget("furrowmapBaseMap")
    box.setCurrentIndex(box.count() - 1)
    widget("furrowmapOwnBaseMap").setText(tiles)
    box.activated.emit(box.count() - 1)
    yield drawn
    SEEN["lowest"] = project.layerTreeRoot().children()[-1].name()
    yield from own_maps(box)
    box.setCurrentIndex(0)
    box.activated.emit(0)
    yield drawn
    SEEN["without_base_map"] = project.layerTreeRoot().children()[-1].name()
    before = groups()
    click("furrowmapDo_map")
    yield lambda: plugin().dock._steps is None
    SEEN["again_the_same"] = groups() == before
    yield drawn
    SEEN["project_round_trip"] = _round_trip(project)


def on_dark(label: Any) -> list[Any]:
    """The darkest and the lightest grey of a label, and the red of verdicts, where the theme is dark."""
    from furrowmap.dock.form_parts import warning_colour

    before = label.palette()
    dark = QPalette(before)
    for role in (QPalette.ColorRole.Window, QPalette.ColorRole.Base):
        dark.setColor(role, QColor(DARK_WINDOW))
    for role in (QPalette.ColorRole.WindowText, QPalette.ColorRole.Text):
        dark.setColor(role, QColor("#c8c8c8"))
    label.setPalette(dark)
    image = label.grab().toImage()
    greys = [image.pixelColor(x, y).lightness() for x in range(image.width()) for y in range(image.height())]
    found = [min(greys), max(greys), warning_colour(label)]
    label.setPalette(before)
    return found


def own_maps(box: Any) -> Iterator[Any]:
    """A raster, MBTiles with their attribution, a WMS, and one that cannot be reached."""
    from furrowmap.basemap import attribution_of, base_map_layers

    tiles, served = Path(OUT) / "field map.mbtiles", Path(OUT) / "served"
    with closing(sqlite3.connect(tiles)) as database, database:
        database.execute("create table metadata (name text, value text)")
        database.execute("create table tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)")
        facts = [
            ("format", "png"),
            ("attribution", "<a href='x'>Village of Ami</a>"),
            ("minzoom", "0"),
            ("maxzoom", "0"),
        ]
        database.executemany("insert into metadata values (?, ?)", facts)
        database.execute("insert into tiles values (0, 0, 0, ?)", [Path(f"{OUT}/run.png").read_bytes()])
    served.mkdir()
    (served / "wms").write_text(CAPABILITIES)
    server = subprocess.Popen(
        ["python3", "-u", "-m", "http.server", "--bind", "127.0.0.1", "--directory", str(served), "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    port = str(server.stdout.readline() if server.stdout else "").split(" port ")[1].split()[0]
    # QGIS asks the service for its capabilities again: their address has to be the server's.
    (served / "wms").write_text(CAPABILITIES.replace("PORT", port))
    bar, SEEN["own_maps"] = iface.messageBar(), {}  # noqa: F821
    own_layers = {
        "dsm": f"{plugin().dock._folder}/dsm.tif",
        "field map": str(tiles),
        "Parcels": f"http://127.0.0.1:{port}/wms",
    }
    for name, own in own_layers.items():
        widget("furrowmapOwnBaseMap").setText(own)
        box.activated.emit(box.count() - 1)
        yield lambda name=name: [layer.name() for layer in base_map_layers(QgsProject.instance())] == [name]
        layers = base_map_layers(QgsProject.instance())
        SEEN["own_maps"][name] = [layers[0].isValid(), attribution_of(layers)]
    server.kill()
    server.wait()
    bar.clearWidgets()
    widget("furrowmapOwnBaseMap").setText(f"http://127.0.0.1:{port}/{{z}}/{{x}}/{{y}}.png")
    widget("furrowmapOwnAttribution").setText("Somebody's tiles")
    credit = iface.mapCanvas().findChild(QWidget, "furrowmapAttribution")  # noqa: F821
    box.activated.emit(box.count() - 1)
    yield lambda: bar.currentItem() is not None
    SEEN["unreachable"] = bar.currentItem().text()
    SEEN["unreached"] = widget("furrowmapUnreached").isVisible()
    yield drawn
    yield lambda: not credit.isVisible()
    SEEN["credit without tiles"] = credit.text()
    shot(f"{OUT}/unreachable.png")  # noqa: F821


def _round_trip(project: Any) -> bool:
    before = groups()
    path = f"{OUT}/session.qgz"
    assert project.write(path)
    project.clear()
    assert project.read(path)
    return groups() == before and all(layer.isValid() for layer in project.mapLayers().values())


def story() -> Iterator[Any]:
    for part in (
        reloads,
        without_worker,
        flight,
        new_session,
        machines,
        many_drives,
        cancelled_run,
        refused_run,
        whole_run,
        on_the_map,
    ):
        yield from part()
    SEEN["dialogs"] = [w.windowTitle() for w in QApplication.topLevelWidgets() if w.isVisible() and w is not WINDOW]
    SEEN["modal"] = QApplication.activeModalWidget() is not None
    SEEN["logged"] = LOGGED
    SEEN["buttons"] = len(plugin().dock.findChildren(QPushButton))


STORY = story()
WAIT: dict[str, Any] = {"for": None, "since": time.monotonic()}


def tick() -> None:
    """Go on with the story as soon as what it waits for has come."""
    now = time.thread_time()
    BUSY["cpu_s"], BUSY["last_s"] = max(BUSY["cpu_s"], now - BUSY["last_s"]), now
    if WAIT["for"] is not None and not WAIT["for"]():
        late = time.monotonic() - WAIT["since"] > LONGEST_S
        bar = iface.messageBar().currentItem()  # noqa: F821
        if late:
            TIMER.stop()
        assert not late, (STORY.gi_frame, STORY.gi_yieldfrom, bar.text() if bar else "")
        return
    try:
        WAIT["for"] = next(STORY)
        WAIT["since"] = time.monotonic()
    except BaseException as end:
        TIMER.stop()
        if not isinstance(end, StopIteration):
            raise
        print(json.dumps(SEEN), flush=True)
        leave()  # noqa: F821
    BUSY["last_s"] = time.thread_time()  # the story's own work (pictures, reloads) is not the plugin's


Path(OUT).mkdir(parents=True, exist_ok=True)
TIMER = QTimer()
TIMER.timeout.connect(tick)
TIMER.start(5)
