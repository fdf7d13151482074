"""The result of a run as ISO 11783-10 task data, which farm management software and terminals read.

A field with its boundary, the machine, and a task with its totals and a time log: where the middle of the tool's line
was, whether it worked, and how wide it is. Version 4 of the standard's files (ISO 11783-10:2015).
"""

import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Geod
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.longitudes import principal_deg
from furrowmap.core.readers.areas.repair import whole_in_degrees
from furrowmap.core.readers.isoxml.content import MAIN
from furrowmap.core.readers.isoxml.log import ACTUAL_WIDTH, EFFECTIVE_DISTANCE, EFFECTIVE_TIME, TOTAL_AREA
from furrowmap.core.readers.isoxml.task_sections import WORK_STATE
from furrowmap.core.readers.isoxml.time_log import EPOCH_S
from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, printable
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.rotation import attitude_to_quaternion, quaternion_to_matrix
from furrowmap.core.values.tool_states import ToolState
from furrowmap.exporters.exchange.vectors import changed_crs
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import BOUNDARY, TRAJECTORY, ResultFolder
from furrowmap.exporters.files.staging import staged_folder

WGS84: Final = Geod(ellps="WGS84")

LOG: Final = "TLG00001"
ARCHIVE_FOLDER: Final = "TASKDATA"
DEVICE: Final = "DVC-1"
MACHINE_ELEMENT: Final = "DET-1"
TOOL_ELEMENT: Final = "DET-2"
FIELD_ID: Final = "PFD1"
TASK: Final = "TSK1"
CLIENT_NAME: Final = "A000000000000000"
"""The NAME (ISO 11783-5) of a machine without one on a bus: arbitrary address, agricultural."""
MAX_DESIGNATOR_LENGTH: Final = 32
DAY_MS: Final = 86_400_000
NO_STATUS: Final = 15
UNDEFINED: Final = 3
"""The work state for unknown."""
OUTLINE_TOLERANCE_M: Final = 0.05
_LOG_RECORD: Final = np.dtype(
    [("ms", "<u4"), ("day", "<u2"), ("lat", "<i4"), ("lon", "<i4"), ("up", "<i4"), ("status", "u1"), ("gps_ms", "<u4"),
     ("gps_day", "<u2"), ("count", "u1")]
)  # fmt: skip
_LOG_VALUE: Final = np.dtype([("channel", "u1"), ("value", "<i4")])
_STATE: Final = 0
_WIDTH: Final = 1
"""Places of the values among the header's."""


def write_task_data(result: ResultFolder, target: Path) -> list[Notice]:
    """Write the result of a run as task data; the source of the boundary, and notices on the change of CRS.

    `target` is the folder for TASKDATA.XML and the time log, or a `.zip` that holds them in a folder TASKDATA.
    """
    implement = result.report["session"].get("implement")
    if implement is None or "passes" not in result.layer_names:
        raise InputError("no-ground", folder=result.folder)
    t_s, state, fix, tool = _tool_records(result, implement)
    outline, notices = _boundary(result, implement)
    layers, changed = changed_crs({"tool": tool}, CRS("EPSG:4326"))
    place = layers["tool"].coordinates
    header = ET.Element("TIM", A="", D="4")
    ET.SubElement(header, "PTN", dict.fromkeys("ABCDHI", ""))
    for ddi in (WORK_STATE, ACTUAL_WIDTH):
        ET.SubElement(header, "DLV", A=f"{ddi:04X}", B="", C=TOOL_ELEMENT)
    files = {
        MAIN: _xml(_main(result, implement, outline, (float(t_s[0]), float(t_s[-1])))),
        f"{LOG}.xml": _xml(header),
        f"{LOG}.bin": _log(t_s, place, state, fix, round(1000.0 * float(implement["width_m"]))),
    }
    if target.suffix.lower() == ".zip":
        with atomic_output(target) as unfinished, zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files.items():
                archive.writestr(zipfile.ZipInfo(f"{ARCHIVE_FOLDER}/{name}", (1980, 1, 1, 0, 0, 0)), data)
    else:
        with staged_folder(target) as staging:
            for name, data in files.items():
                (staging / name).write_bytes(data)
    return [*notices, *changed]


def _tool_records(
    result: ResultFolder, implement: dict[str, Any]
) -> tuple[FloatArray, NDArray[np.int8], NDArray[np.uint8], VectorLayer]:
    """(t_s, state, fix, place) of the records: the poses, and the times at which the tool was lowered or lifted."""
    layer = result.layer(TRAJECTORY)
    passes = _of_tool(result.layer("passes"), implement)
    poses = layer.columns
    t_s = poses["t_s"]
    attitude = (poses[f"{name}_deg"] for name in ("roll", "pitch", "heading"))
    turn = quaternion_to_matrix(attitude_to_quaternion(*attitude))
    xyz = layer.coordinates + turn @ np.array([*implement["xy_m"], 0.0])
    begin_s, end_s = (
        passes.columns[name].astype("datetime64[ms]").astype(np.int64) / 1000.0 for name in ("start", "end")
    )
    moments = np.concatenate([begin_s, end_s])
    moments = moments[(moments > t_s[0]) & (moments < t_s[-1])]
    all_s = np.unique(np.round(np.concatenate([t_s, moments]) * 1000.0)) / 1000.0
    before = np.clip(np.searchsorted(t_s, all_s + 5e-4, side="right") - 1, 0, len(t_s) - 1)
    words = poses["implement"][before]
    state = np.select([words == ToolState.UP.label, words == ToolState.DOWN.label], [0, 0], UNDEFINED).astype(np.int8)
    for first_s, last_s in zip(begin_s.tolist(), end_s.tolist(), strict=True):
        state[(all_s >= first_s - 5e-4) & (all_s < last_s - 5e-4)] = 1
    codes = {fix.label: int(fix) for fix in Fix}
    fix = np.array([codes.get(word, NO_STATUS) for word in poses["fix"]], np.uint8)[before]
    place = np.column_stack([np.interp(all_s, t_s, xyz[:, k]) for k in range(3)])
    return all_s, state, fix, VectorLayer(np.asarray(shapely.points(place)), {}, layer.crs)


def _of_tool(layer: VectorLayer, implement: dict[str, Any]) -> VectorLayer:
    """The features of the tool that moves the soil, where a layer has those of several."""
    return layer.where(layer.columns["tool"] == implement["name"]) if "tool" in layer.columns else layer


def _boundary(result: ResultFolder, implement: dict[str, Any]) -> tuple[BaseGeometry, list[Notice]]:
    """The field's boundary in longitude and latitude: the session's, or the outline of the worked ground."""
    if BOUNDARY in result.layer_names:
        stated = result.layer(BOUNDARY)
        boundary = VectorLayer(np.array([shapely.union_all(stated.shapes)]), {}, stated.crs)
        changed, _ = changed_crs({BOUNDARY: boundary}, CRS("EPSG:4326"))
        return whole_in_degrees(changed[BOUNDARY].shapes)[0], []
    notice = Notice("boundary-from-work")
    coverage = _of_tool(result.layer("coverage"), implement)
    half = 0.5 * float(implement["width_m"])
    whole = shapely.union_all(coverage.shapes)
    closed = shapely.buffer(shapely.buffer(whole, half, join_style="mitre"), -half, join_style="mitre")
    outline = VectorLayer(np.array([shapely.simplify(closed, OUTLINE_TOLERANCE_M)]), {}, coverage.crs)
    changed, _ = changed_crs({"outline": outline}, CRS("EPSG:4326"))
    return whole_in_degrees(changed["outline"].shapes)[0], [notice]


def _log(t_s: FloatArray, place: FloatArray, state: NDArray[np.int8], fix: NDArray[np.uint8], width_mm: int) -> bytes:
    """The binary records, with values only where they change; `fix` has the codes of NMEA 0183 (and NMEA 2000)."""
    ms = np.round((t_s - EPOCH_S) * 1000.0).astype(np.int64)
    records = np.zeros(len(t_s), _LOG_RECORD)
    records["ms"] = ms % DAY_MS
    records["day"] = ms // DAY_MS
    records["gps_ms"], records["gps_day"] = records["ms"], records["day"]
    records["lon"] = np.round(1e7 * place[:, 0])
    records["lat"] = np.round(1e7 * place[:, 1])
    records["up"] = np.round(1000.0 * np.where(np.isfinite(place[:, 2]), place[:, 2], 0.0))
    records["status"] = fix
    changes = np.flatnonzero(np.diff(state, prepend=np.int8(-1)) != 0)
    records["count"][changes] = 1
    records["count"][0] = 2
    pieces = []
    for at, to in zip(changes, np.append(changes[1:], len(records)), strict=True):
        values = [(_STATE, state[at]), (_WIDTH, width_mm)][: int(records["count"][at])]
        parts = records[at : at + 1], np.array(values, _LOG_VALUE), records[at + 1 : to]
        pieces += [part.tobytes() for part in parts]
    return b"".join(pieces)


def _main(
    result: ResultFolder, implement: dict[str, Any], outline: BaseGeometry, span_s: tuple[float, float]
) -> ET.Element:
    root = ET.Element(
        "ISO11783_TaskData",
        VersionMajor="4",
        VersionMinor="3",
        ManagementSoftwareManufacturer="furrowmap",
        ManagementSoftwareVersion=version("furrowmap"),
        TaskControllerManufacturer="furrowmap",
        TaskControllerVersion=version("furrowmap"),
        DataTransferOrigin="2",
    )
    origin = "".join(f"\n  {name}: {text}" for name, text in result.origin.metadata.items())
    root.append(ET.Comment(f"{origin.replace('--', '- -')}\n"))
    kind = _name(str(implement.get("kind") or "implement"))
    device = ET.SubElement(
        root, "DVC", A=DEVICE, B=kind, C=version("furrowmap"), D=CLIENT_NAME, F="00000000000001", G="FF000000406E65"
    )
    ET.SubElement(device, "DET", A=MACHINE_ELEMENT, B="1", C="1", D=kind, E="0", F="0")
    tool = ET.SubElement(device, "DET", A=TOOL_ELEMENT, B="2", C="2", D=kind, E="1", F="1")
    described = (
        (WORK_STATE, "9", "Work state"),
        (ACTUAL_WIDTH, "9", "Working width"),
        (TOTAL_AREA, "16", "Area"),
        (EFFECTIVE_DISTANCE, "16", "Distance at work"),
        (EFFECTIVE_DISTANCE + 1, "16", "Other distance"),
        (EFFECTIVE_TIME, "16", "Time at work"),
        (EFFECTIVE_TIME + 1, "16", "Other time"),
    )
    for number, (ddi, trigger, name) in enumerate(described, start=3):
        ET.SubElement(tool, "DOR", A=str(number))
        ET.SubElement(device, "DPD", A=str(number), B=f"{ddi:04X}", C="1", D=trigger, E=name)
    figures = result.report["figures"]
    parts = [part for part in shapely.get_parts(outline) if isinstance(part, shapely.Polygon)]
    area_m2 = sum(abs(WGS84.geometry_area_perimeter(shapely.orient_polygons(part))[0]) for part in parts)
    field = ET.SubElement(root, "PFD", A=FIELD_ID, C=_name(result.name), D=str(round(area_m2)))
    for part in parts:
        polygon = ET.SubElement(field, "PLN", A="1")
        for kind, ring in (("1", part.exterior), *(("2", hole) for hole in part.interiors)):
            line = ET.SubElement(polygon, "LSG", A=kind)
            for lon, lat in shapely.get_coordinates(ring)[:-1].tolist():
                ET.SubElement(line, "PNT", A="2", C=f"{lat:.9f}", D=f"{principal_deg(lon):.9f}")
    task = ET.SubElement(root, "TSK", A=TASK, B=_name(result.name), E=FIELD_ID, G="4")
    begin, end = (f"{np.datetime64(round(1000.0 * t), 'ms')}Z" for t in span_s)
    time = ET.SubElement(task, "TIM", A=begin, B=end, D="4")
    hours = figures["hours"]
    for ddi, value in (
        (TOTAL_AREA, figures["worked_area_ellipsoid_m2"]),
        (EFFECTIVE_DISTANCE, 1000.0 * figures["worked_length_m"]),
        (EFFECTIVE_DISTANCE + 1, 1000.0 * max(figures["distance_m"] - figures["worked_length_m"], 0.0)),
        (EFFECTIVE_TIME, hours["working_s"]),
        (EFFECTIVE_TIME + 1, hours["turning_s"] + hours["idle_s"]),
    ):
        ET.SubElement(time, "DLV", A=f"{ddi:04X}", B=str(round(value)), C=TOOL_ELEMENT)
    ET.SubElement(task, "TLG", A=LOG, C="1")
    ET.SubElement(task, "DAN", A=CLIENT_NAME, C=DEVICE)
    return root


def _name(text: str) -> str:
    """A designator: printable text of at most the standard's length."""
    return printable(text)[:MAX_DESIGNATOR_LENGTH] or "field"


def _xml(element: ET.Element) -> bytes:
    ET.indent(element)
    text: bytes = ET.tostring(element, encoding="UTF-8", xml_declaration=True)
    return text
