"""Runs inside the desktop QGIS (scripts/qgis_desktop.sh): what the plugin does with a project and the user's layers.

Arguments: scripted_worker.py's command, folders with the results of a drive and of a flight, a point cloud, folder for
what it writes. What was seen is printed at the end as one line of JSON.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

WORKER, DRIVE, FLIGHT, CLOUD, OUT = (Path(word) for word in arguments)  # noqa: F821 - given by qgis_desktop.sh
sys.path.insert(0, str(WORKER.parent))

import qgis.utils  # noqa: E402
from desktop import click, current_page, drop, idle, page, plugin, tell, widget  # noqa: E402
from qgis import processing  # noqa: E402
from qgis.core import (  # noqa: E402
    QgsColorRampShader,
    QgsCoordinateReferenceSystem,
    QgsDateTimeRange,
    QgsFeature,
    QgsInterval,
    QgsLayoutExporter,
    QgsLayoutItemLegend,
    QgsProject,
    QgsRasterLayer,
    QgsSettings,
    QgsSingleBandPseudoColorRenderer,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QDate, QDateTime, QTime  # noqa: E402
from qgis.PyQt.QtWidgets import QDockWidget, QPushButton  # noqa: E402

SEEN: dict[str, Any] = {}
PROJECT = QgsProject.instance()
WINDOW = iface.mainWindow()  # noqa: F821
KEY = "furrowmap/key"
os.environ["FURROWMAP_MACHINES"] = str(OUT / "machines")


def told(**more: Any) -> None:
    (WORKER.parent / "begun").unlink(missing_ok=True)
    (WORKER.parent / "ways.json").write_text(json.dumps(more))


def drawn() -> bool:
    return not iface.mapCanvas().isDrawing()  # noqa: F821


def picture(name: str) -> Iterator[Any]:
    yield
    yield drawn
    yield
    yield drawn
    shot(f"{OUT}/{name}.png")  # noqa: F821


def opened(folder: Path) -> Iterator[Any]:
    plugin().dock.open_folder(folder)
    yield lambda: idle() and current_page() == "result"


def group_of(folder: Path) -> Any:
    from furrowmap.results import groups_of

    return groups_of(PROJECT, folder)[0]


def foreign(group: Any) -> dict[str, str]:
    """Layers of the user in a group of the plugin: a scratch layer, a copy of one of the plugin's, one in a group."""
    first = group.findLayers()[0].layer()
    source = "Point?crs=EPSG:6677&field=n:int"
    scratch, inner = (QgsVectorLayer(source, name, "memory") for name in ("scratch", "inner"))
    copy = first.clone()
    copy.setName("my copy")
    for layer in (scratch, inner, copy):
        PROJECT.addMapLayer(layer, False)
    group.insertLayer(0, scratch)
    group.addLayer(copy)
    group.addGroup("mine").addLayer(inner)
    others = (node.layer() for node in group.findLayers() if node.layer() is not copy)
    edited = next(layer for layer in others if isinstance(layer, QgsVectorLayer) and layer.customProperty(KEY))
    edited.setCustomProperty("skipMemoryLayersCheck", 1)
    assert edited.startEditing()
    assert edited.addFeature(QgsFeature(edited.fields()))
    return {layer.name(): layer.id() for layer in (scratch, inner, copy)} | {"edited": edited.id()}


def lost(known: dict[str, str]) -> list[str]:
    """Which of them are no longer in the project, or no longer in the layer panel."""
    root = PROJECT.layerTreeRoot()
    return [name for name, key in known.items() if PROJECT.mapLayer(key) is None or root.findLayer(key) is None]


def unread() -> list[str]:
    """Vector layers in the layer panel whose features QGIS cannot read."""
    layers = [node.layer() for node in PROJECT.layerTreeRoot().findLayers()]
    return [layer.name() for layer in layers if isinstance(layer, QgsVectorLayer) and layer.featureCount() < 0]


def users_layers() -> Iterator[Any]:
    """Layers of the user in the plugin's groups survive every action that clears layers."""
    from furrowmap.previews import open_preview

    dock = plugin().dock
    told(run="done", farm="done", answers={
        "run": {"folder": str(DRIVE), "products": ["report.json"], "figures": {}}, "farm": {"sessions": 1},
    })  # fmt: skip
    # Before QGIS opens them: a file that this process opens and closes itself loses the locks of SQLite.
    shutil.copytree(DRIVE.parent, OUT / "second")
    farm = OUT / "farm.gpkg"
    shutil.copyfile(DRIVE / "field.gpkg", farm)
    preview = OUT / "preview"
    preview.mkdir()
    report = json.loads((DRIVE / "report.json").read_text())
    (preview / "preview.json").write_text(json.dumps({"session": report["session"], "inputs": report["inputs"]}))
    shutil.copyfile(DRIVE / "field.gpkg", preview / "preview_track.gpkg")
    yield from opened(DRIVE)
    known = {f"result: {name}": key for name, key in foreign(group_of(DRIVE)).items()}
    dock._show_farm(str(farm), 1)
    yield
    open_preview(preview)
    for group in PROJECT.layerTreeRoot().findGroups():
        for kind in ("farmMap", "preview"):
            if group.customProperty(f"furrowmap/{kind}"):
                known |= {f"{kind}: {name}": key for name, key in foreign(group).items()}
    base = widget("furrowmapBaseMap")
    widget("furrowmapOwnBaseMap").setText(str(DRIVE / "dsm.tif"))
    base.setCurrentIndex(base.count() - 1)
    base.activated.emit(base.count() - 1)
    yield
    mine = next(layer for layer in PROJECT.mapLayers().values() if layer.customProperty("furrowmap/basemap")).clone()
    PROJECT.addMapLayer(mine)
    known["base map: my copy"] = mine.id()
    SEEN["placed"] = lost(known)

    def add_to_map() -> Iterator[Any]:
        yield from opened(DRIVE)
        click("furrowmapDo_map")
        yield lambda: idle() and current_page() == "result"

    def rerun() -> Iterator[Any]:
        dock.run_session(DRIVE.parent / "session.toml")
        yield page("result")
        yield idle

    def drop_on(target: Any, path: Path) -> Callable[[], Iterator[Any]]:
        def go() -> Iterator[Any]:
            drop(target, [path])
            yield
            yield idle

        return go

    def other_session() -> Iterator[Any]:
        yield from opened(FLIGHT)
        yield from opened(DRIVE)

    def batch() -> Iterator[Any]:
        os.utime(OUT / "second" / "session_result" / "report.json", (4e9, 4e9))
        os.utime(DRIVE / "report.json", (4e9, 4e9))
        drop(dock, [DRIVE.parent, OUT / "second"])
        yield idle
        rows = widget("furrowmapBatch")
        rows.itemActivated.emit(rows.item(0))
        yield lambda: idle() and current_page() == "result"

    def replay() -> Iterator[Any]:
        click("furrowmapDo_replay")
        yield
        dock._end_replay()
        yield

    def themes() -> Iterator[Any]:
        for theme in ("quality", "work"):
            dock.result.theme_wanted.emit(theme)
            yield

    def farm_map() -> Iterator[Any]:
        dock.add_to_farm([DRIVE], str(farm))
        yield lambda: idle() and current_page() == "result"

    def other_base_map() -> Iterator[Any]:
        for number in (base.count() - 1, 0):
            base.setCurrentIndex(number)
            base.activated.emit(number)
            yield

    def cloud() -> Iterator[Any]:
        drop(dock, [CLOUD])
        yield
        iface.messageBar().clearWidgets()  # noqa: F821

    def surfaces() -> Iterator[Any]:
        yield from surfaces_of_cloud()

    def reload() -> Iterator[Any]:
        assert qgis.utils.unloadPlugin("furrowmap")
        yield
        assert qgis.utils.loadPlugin("furrowmap")
        assert qgis.utils.startPlugin("furrowmap")
        plugin().dock.show()
        yield

    SEEN["lost"] = {}
    SEEN["unread"] = {}
    for action, steps in {
        "add to map": add_to_map,
        "rerun": rerun,
        "drop on the dock": drop_on(dock, DRIVE),
        "drop on the window": drop_on(WINDOW, DRIVE),
        "preview dropped": drop_on(dock, preview),
        "another session": other_session,
        "batch": batch,
        "replay": replay,
        "themes": themes,
        "farm map": farm_map,
        "base map": other_base_map,
        "cloud": cloud,
        "surfaces": surfaces,
        "plugin reloaded": reload,
    }.items():
        yield from steps()
        SEEN["lost"][action] = lost(known)
        SEEN["unread"][action] = unread()
    for layer in PROJECT.mapLayers().values():
        if isinstance(layer, QgsVectorLayer) and layer.isEditable():
            layer.rollBack()
    PROJECT.clear()


def surfaces_of_cloud() -> Iterator[Any]:
    """The layers that an algorithm leaves, opened as QGIS does."""
    folder = OUT / "surfaces"
    folder.mkdir(exist_ok=True)
    names = ("dsm.tif", "dtm.tif", "height_above_ground.tif")
    for name, source in zip(names, ("dsm.tif", "dsm.tif", "change.tif"), strict=True):
        shutil.copyfile(DRIVE / source, folder / name)
    told(surface="done", answers={"surface": {"folder": str(folder), "products": list(names)}})
    known = set(PROJECT.mapLayers())
    processing.runAndLoadResults("furrowmap:surface", {"CLOUDS": [str(CLOUD)], "OUTPUT": str(folder), "OPEN": True})
    yield
    nodes = [node for node in PROJECT.layerTreeRoot().findLayers() if node.layerId() not in known]
    SEEN["surfaces"] = {
        "group": sorted({node.parent().name() for node in nodes}),
        "layers": [[node.layer().customProperty(KEY), node.layer().name(), node.isVisible()] for node in nodes],
    }


def legend_of(node: Any) -> dict[str, Any]:
    """What the panel shows of a raster's colours, and what the raster holds."""
    layer = node.layer()
    renderer = layer.renderer()
    model = iface.layerTreeView().layerTreeModel()  # noqa: F821
    title = node.customProperty("legend/label-0") or ""
    told_ends: list[str] = []
    values: list[float] = []
    if isinstance(renderer, QgsSingleBandPseudoColorRenderer):
        shader = renderer.shader().rasterShaderFunction()
        items = shader.colorRampItemList()
        values = [item.value for item in items]
        if shader.colorRampType() == QgsColorRampShader.Type.Interpolated:
            ends = shader.legendSettings()
            told_ends = [ends.minimumLabel(), ends.maximumLabel()]
        else:
            told_ends = [items[0].label, items[-1].label]
    return {
        "title": title,
        "ends": told_ends,
        "values": [values[0], values[-1]] if values else [],
        "band": layer.bandName(1),
        "nodes": len(model.layerLegendNodes(node)),
        "path": layer.source(),
    }


def languages() -> Iterator[Any]:
    """Titles and legends of a drive and a flight, as opened, and after the project was saved and read again."""
    from qgis.core import QgsApplication
    from qgis.PyQt.QtCore import QCoreApplication, QLocale

    from furrowmap.translation import install_translator

    SEEN["languages"] = {}
    for language in ("en", "de", "ja"):
        QgsApplication.setLocale(QLocale(language))
        translator = install_translator(language)
        PROJECT.clear()
        yield from opened(DRIVE)
        yield from opened(FLIGHT)
        nodes = [node for node in PROJECT.layerTreeRoot().findLayers() if node.layer().customProperty(KEY)]
        rasters = [node for node in nodes if isinstance(node.layer(), QgsRasterLayer)]
        titles = sorted([node.layer().customProperty(KEY), node.name()] for node in nodes)
        themes = PROJECT.mapThemeCollection().mapThemes()
        found = {
            "legends": {f"{k} {n.layer().customProperty(KEY)}": legend_of(n) for k, n in enumerate(rasters)},
            "titles": titles,
            "themes": themes,
        }
        assert PROJECT.write(f"{OUT}/{language}.qgz")
        PROJECT.clear()
        yield
        found["page without project"] = current_page()
        assert PROJECT.read(f"{OUT}/{language}.qgz")
        yield
        nodes = [node for node in PROJECT.layerTreeRoot().findLayers() if node.layer().customProperty(KEY)]
        found["titles again"] = sorted([node.layer().customProperty(KEY), node.name()] for node in nodes)
        found["themes again"] = PROJECT.mapThemeCollection().mapThemes()
        found["page again"] = [current_page(), str(plugin().dock._folder), widget("furrowmapTheme").currentData()]
        SEEN["languages"][language] = found
        if translator is not None:
            QCoreApplication.removeTranslator(translator)
    QgsApplication.setLocale(QLocale("en"))
    PROJECT.clear()
    yield


def visible_keys() -> list[str]:
    return [n.layer().customProperty(KEY) for n in PROJECT.layerTreeRoot().findLayers() if n.isVisible()]


def one_at_a_time() -> Iterator[Any]:
    """A second result hides the first, and takes its CRS where only the plugin's layers are."""
    yield from opened(DRIVE)
    yield from opened(FLIGHT)
    SEEN["crs"] = PROJECT.crs().authid()
    SEEN["seen together"] = sorted({n.parent().name() for n in PROJECT.layerTreeRoot().findLayers() if n.isVisible()})
    yield from picture("flight")
    names = PROJECT.mapThemeCollection().mapThemes()
    crops = next(name for name in names if "Crops" in name)
    work = next(name for name in names if "Worked ground" in name)
    view = iface.layerTreeView()  # noqa: F821
    SEEN["by QGIS's themes"] = {}
    for name in (work, crops):
        PROJECT.mapThemeCollection().applyTheme(name, PROJECT.layerTreeRoot(), view.layerTreeModel())
        yield
        SEEN["by QGIS's themes"][name] = visible_keys()
    PROJECT.clear()
    PROJECT.addMapLayer(QgsVectorLayer("Point?crs=EPSG:4326", "mine", "memory"))
    PROJECT.setCrs(QgsCoordinateReferenceSystem("EPSG:6677"))
    yield from opened(FLIGHT)
    SEEN["crs beside mine"] = PROJECT.crs().authid()
    bar = iface.messageBar().currentItem()  # noqa: F821
    SEEN["offered crs"] = bar.text() if bar is not None else ""
    yield from picture("crs")
    bar.findChild(QPushButton, "furrowmapUseCrs").click()
    yield
    SEEN["crs taken"] = PROJECT.crs().authid()
    PROJECT.clear()
    yield


def printed() -> Iterator[Any]:
    """The pages of all themes, each with the legend of the colours that it shows."""
    from furrowmap.results import read_report, themes_of
    from furrowmap.session_layout import session_layout

    SEEN["printed"] = {}
    for folder in (DRIVE, FLIGHT):
        yield from opened(folder)
        for theme in themes_of(group_of(folder)):
            plugin().dock.result.theme_wanted.emit(theme)
            yield
            layout = session_layout(PROJECT, group_of(folder), read_report(folder))
            legends = [item for item in layout.items() if isinstance(item, QgsLayoutItemLegend)]
            nodes = legends[0].model().rootGroup().findLayers()
            shown = [node.layer().customProperty(KEY) for node in nodes]
            SEEN["printed"][f"{folder.parent.name} {theme}"] = [shown, visible_keys()]
            name = f"{OUT}/{folder.parent.name}_{theme}.png"
            settings = QgsLayoutExporter.ImageExportSettings()
            settings.dpi = 100
            QgsLayoutExporter(layout).exportToImage(name, settings)
        PROJECT.clear()
        yield


def replayed() -> Iterator[Any]:
    """Replay gives the temporal controller back as it was."""
    controller = iface.mapCanvas().temporalController()  # noqa: F821
    start = QDateTime(QDate(2020, 1, 1), QTime(0, 0))
    controller.setTemporalExtents(QgsDateTimeRange(start, start.addDays(10)))
    controller.setFrameDuration(QgsInterval(3600.0))
    controller.setFramesPerSecond(3.0)
    dock = next(d for d in WINDOW.findChildren(QDockWidget) if d.objectName() == "Temporal Controller")
    dock.hide()

    def state() -> list[Any]:
        extents = controller.temporalExtents()
        return [
            int(controller.navigationMode()),
            extents.begin().date().toString("yyyyMMdd"),
            extents.end().date().toString("yyyyMMdd"),
            controller.frameDuration().seconds(),
            controller.framesPerSecond(),
            dock.isVisible(),
        ]

    yield from opened(DRIVE)
    controller.setTemporalExtents(QgsDateTimeRange(start, start.addDays(10)))
    before = state()
    click("furrowmapDo_replay")
    yield lambda: controller.currentFrameNumber() >= 2
    SEEN["replaying"] = state()
    plugin().dock._end_replay()
    yield
    SEEN["controller"] = [before, state()]
    click("furrowmapDo_replay")
    yield lambda: controller.currentFrameNumber() >= 2
    controller.setNavigationMode(controller.NavigationMode.NavigationOff)
    yield
    SEEN["controller turned off"] = [before, state()]
    PROJECT.clear()
    yield


def story() -> Iterator[Any]:
    QgsSettings().setValue("furrowmap/interpreter", str(WORKER))
    plugin().dock.show_start()
    WINDOW.resizeDocks([WINDOW.findChild(QDockWidget, "Layers")], [260], 1)
    yield
    for part in (users_layers, one_at_a_time, printed, replayed, languages):
        yield from part()
        sys.stderr.write(f"{part.__name__} is told\n")


OUT.mkdir(parents=True, exist_ok=True)
tell(story(), SEEN, iface, leave)  # noqa: F821
