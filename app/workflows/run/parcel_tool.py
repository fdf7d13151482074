"""The parcels of a session, measured by the points of its run."""

import datetime as dt
import math
from time import perf_counter
from typing import Any

import numpy as np
from markupsafe import Markup

from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.crops.parcel_points import PUBLISHED_STRIP_M, ParcelPoints
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import OpenSession
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.reports.parcel_sections import parcel_sections
from furrowmap.exporters.vectors.crop_layers import parcel_layer
from furrowmap.settings import ParcelSettings, soil_file
from furrowmap.workflows.crops.parcels import (
    WrittenParcels,
    assign_treatments,
    expect_soil,
    held_against_surface,
    write_parcels,
)
from furrowmap.workflows.run.tools import CloudMade, RunTool, ToolFindings


class ParcelTool(RunTool):
    """Measures the parcels of `[parcels]`, if a scanner sees them."""

    measures = True

    def __init__(self, opened: OpenSession) -> None:
        self._opened = opened
        self._settings = parcel_settings(opened)
        self._points: ParcelPoints | None = None
        self._written: WrittenParcels | None = None
        self._measured_s = 0.0

    def open(self) -> None:
        """Read the parcels; errors of their files are raised here."""
        path = self._opened.inputs.parcels
        if path is None or not self._opened.session.recording.lidar:
            return
        settings = self._settings
        areas, decided = read_parcels(path, self._opened.frame.crs, settings.net_inset_m)
        assign_treatments(areas, settings, dt.date.max)
        around_m = PUBLISHED_STRIP_M if settings.published else None
        points = self.stack.enter_context(ParcelPoints(areas, self.folder, around_m, decided))
        expect_soil(soil_file(settings.soil), self._opened.frame.crs, points.box_m)
        self._points = points

    def add(self, placed: PlacedScan) -> None:
        """Keep the points on parcels and near them."""
        if self._points is not None:
            self._points.add(placed.xyz_m[placed.kept] + self.origin_m)

    def measure(self, origin: Origin, progress: Progress) -> None:
        """Measure the parcels, and write their table and the raster of crop heights."""
        if self._points is not None:
            begin = perf_counter()
            crs = self._opened.frame.whole_crs
            self._written = write_parcels(self.folder, self._points, self._settings, crs, origin, progress)
            self._measured_s = perf_counter() - begin

    def finish(self, made: CloudMade) -> ToolFindings:
        """The parcels, and whether the crop on the surface stands beside them."""
        if self._written is None:
            return ToolFindings()
        sigma = made.found.placement.poses.sigma.copy()
        east_m, north_m = np.sqrt(np.mean(sigma[:, :2] ** 2, axis=0)).tolist()
        written = held_against_surface(self._written, self.folder, self._opened.frame, (east_m, north_m))
        shift = written.shift
        doubted = shift is not None and shift.of_positions  # parcels may be right, and the positions off
        if shift is not None and doubted:
            sigma[:, :2] = np.hypot(sigma[:, :2], (shift.east_m, shift.north_m))
        heights_m = [row.figures.mean_height_m for row in written.found]
        page = {
            "heights_m": [height_m for height_m in heights_m if math.isfinite(height_m)],
            "parcels": Markup(parcel_sections(written.found, written.response)),  # noqa: S704 (of a template)
        }
        return ToolFindings(
            {"parcels": written.account},
            written.notices,
            [parcel_layer(written.found)],
            page,
            sigma if doubted else None,
            {"parcels": self._measured_s},
        )


def parcel_settings(opened: OpenSession) -> ParcelSettings:
    """The settings in `[parcels]` of a session."""
    stated = opened.session.parcels
    if stated is None:
        return ParcelSettings()
    method: Any = stated.method or "canopy-top"
    soil = opened.inputs.soil or stated.soil or "surface"
    treatments = opened.inputs.treatments
    return ParcelSettings(net_inset_m=stated.net_inset_m, method=method, soil=soil, treatments=treatments)
