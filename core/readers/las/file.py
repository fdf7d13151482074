"""Inspection of LAS, LAZ, COPC, PCD, PLY and E57 files."""

from typing import Any, ClassVar, Final

import numpy as np

from furrowmap.core.readers.las.header import SIGNATURE
from furrowmap.core.readers.las.pcd_ply import POINT_SIGNATURES
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.scan import Clock, ClockReading

LAS_CLASSES: Final = {
    0: "never classified", 1: "unclassified", 2: "ground", 3: "low vegetation", 4: "medium vegetation",
    5: "high vegetation", 6: "building", 7: "noise", 8: "model key point", 9: "water", 10: "rail", 11: "road",
    12: "overlap", 13: "wire guard", 14: "wire conductor", 15: "tower", 16: "wire connector", 17: "bridge deck",
    18: "high noise",
}  # fmt: skip
"""LAS 1.4 R15, table 17."""
OWN_CLASSES: Final = {64: "vehicle", 65: "implement"}
"""Classes of clouds by furrowmap."""


class LasCloud(FileReader):
    """A georeferenced point cloud: it can be inspected and used for surfaces; it has no scans."""

    format: ClassVar[str] = "las"
    title: ClassVar[Text] = Text("LAS, LAZ or COPC point cloud")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """By its signature."""
        return 1.0 if head.data.startswith(SIGNATURE) else 0.0

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        from furrowmap.core.readers.las.cloud import open_cloud, survey

        path = self.paths[0]
        with path.open("rb") as file:
            if file.read(4) != SIGNATURE:
                raise InputError("cloud-in-archive", path=path)
        cloud = open_cloud(path)
        found = survey(cloud)
        header = cloud.header
        self.notices = [*cloud.notices, *found.notices()]
        facts: dict[str, Any] = {
            "version": f"LAS 1.{header.version}, point format {header.point_format}",
            "compression": {"las": "none", "laz": "LAZ", "copc": "LAZ, in an octree (COPC)"}[cloud.format],
            "points": found.points,
            "crs": "none stated",
        }
        if cloud.crs is not None:
            epsg = cloud.crs.to_epsg()
            facts["crs"] = f"EPSG:{epsg} ({cloud.crs.name})" if epsg is not None else cloud.crs.name
        if found.points:
            digits = [max(0, min(12, round(-np.log10(step)))) for step in header.scale]
            facts |= {
                axis: [round(low, places), round(high, places)]
                for axis, low, high, places in zip("xyz", found.low.tolist(), found.high.tolist(), digits, strict=True)
            }
            names = LAS_CLASSES | (OWN_CLASSES if header.software.startswith("furrowmap") else {})
            facts["points_by_class"] = {
                f"{number} {names.get(number, '')}".strip(): int(found.by_class[number])
                for number in np.flatnonzero(found.by_class).tolist()
            }
            facts["points_by_return"] = {
                str(number): int(found.by_return[number]) for number in np.flatnonzero(found.by_return).tolist()
            }
        if found.withheld:
            facts["withheld"] = found.withheld
        facts["scale"] = list(header.scale)
        facts["gps_time"] = str(cloud.clock)
        if header.has_time and found.first_time <= found.last_time:
            facts["gps_times"] = [round(found.first_time, 6), round(found.last_time, 6)]
        facts["dimensions"] = list(cloud.dimensions)
        facts["created"] = header.created.isoformat() if header.created else "not stated"
        facts |= {name: value for name, value in (("system", header.system), ("software", header.software)) if value}
        clocks = []
        if found.utc_s is not None:
            clocks.append(ClockReading(Clock.STATED, *found.utc_s, "GPS time minus leap seconds"))
        return Inspection(path, self.format, self.title, facts, tuple(clocks), tuple(self.notices))


class PointFile(FileReader):
    """Points in PCD, PLY or E57: they can be inspected and used like a LAS file; their CRS has to be stated."""

    format: ClassVar[str] = "pcd-ply"
    title: ClassVar[Text] = Text("PCD, PLY or E57 point cloud")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """By its signature."""
        return 1.0 if head.data.startswith(POINT_SIGNATURES) else 0.0

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        from furrowmap.core.readers.las.cloud import open_cloud, survey

        path = self.paths[0]
        with path.open("rb") as file:
            if not file.read(16).startswith(POINT_SIGNATURES):
                raise InputError("cloud-in-archive", path=path)
        cloud = open_cloud(path)
        found = survey(cloud)
        self.notices = list(cloud.notices)
        ranges = zip("xyz", found.low.tolist(), found.high.tolist(), strict=True)
        facts: dict[str, Any] = {
            "points": found.points,
            "crs": "none stated",
            **{axis: [round(low, 4), round(high, 4)] for axis, low, high in ranges},
            "dimensions": list(cloud.dimensions),
        }
        return Inspection(path, self.format, self.title, facts, (), tuple(self.notices))
