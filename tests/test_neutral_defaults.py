"""What is not stated is nothing: defaults of functions and values are zero, false or unknown, or listed here with why.

A default that changes from 0 to 1 fails nowhere near it, because callers that state a value do not notice. Those of
scenarios are held by their page.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import Final

from tests.syntax import CHECKOUT, PARTS, files, tree

HELD_BY_PAGES: Final = ("core/simulator/scenario.py",)

EVERY_ONE: Final = {
    "core/pointclouds/cleaning_steps.py Cleaning.every": 1,
    "core/pointclouds/spool_clouds.py spool_clouds(every)": 1,
    "app/workflows/calibrate/mount.py calibrate_mount(every)": 1,
    "app/settings.py _every(default)": 1,
    "core/matching/clock_offset.py _Trial.agreement(every)": 1,
    "core/values/plot_grid.py PlotGrid.first": 1,  # plots are counted from 1
    "core/values/plot_grid.py PlotGrid.block_size": 1,
    "exporters/files/atomic.py atomic_output(durable)": True,  # a power cut loses no product
    "core/readers/source.py Source.read(size)": -1,  # all, as of any stream
    "app/workflows/live/feeds.py Growing.read(size)": -1,
    "app/workflows/live/server.py BoundedHead.readline(size)": -1,
    "app/workflows/live/live.py live(port)": 8080,
    "app/workflows/live/live.py live(nmea_port)": 10110,  # registered for NMEA 0183
    "core/readers/framed_messages.py find_frames(last)": True,
    "core/readers/nmea/sentences.py scan_bytes(last)": True,
    "core/readers/vectornav/log.py BinaryMessages.scan(last)": True,
    "core/readers/vectornav/log.py AsciiSentences.scan(last)": True,
    "core/readers/geotiff.py open_geotiff(with_heights)": True,
    "core/values/scan.py Scan.whole": True,
    "core/values/session.py Run.standing": True,
    "core/values/session.py CameraSource.aid": True,
    "core/session/frame_tree.py Frame.has_axes": True,  # a frame is drawn with its axes
}
"""Nothing is left out unasked."""
FACTORS: Final = {
    "core/images/image_frames.py FramePoses.scale": 1.0,
    "core/images/image_frames.py frame_poses(scale)": 1.0,
    "core/readers/framed_messages.py Messages.column(factor)": 1.0,
    "exporters/share/page_features.py _number(factor)": 1.0,
    "exporters/share/symbols.py LayerStyle.opacity": 1.0,  # what states none is opaque
    "exporters/share/symbols.py Ramp.colour(opacity)": 1.0,
    "core/values/session.py ImuColumn.scale": 1.0,
    "core/values/session.py Imu.rate_scale": 1.0,
    "core/values/session.py Imu.force_scale": 1.0,
    "core/values/inertial.py StatedUnits.rate_scale": 1.0,
    "core/values/inertial.py StatedUnits.force_scale": 1.0,
    "core/matching/ground_registration.py Relief.noise": 1.0,
    "core/simulator/machine_motion.py SimulatedMotion.scale": 1.0,
    "core/pointclouds/placed_scans.py Placer.scale": 1.0,
    "core/pipeline/solution.py placer_of(scale)": 1.0,
    "core/crops/measure.py measure_parcels(scale)": 1.0,
    "core/crops/parcel_areas.py plot_grid(scale)": 1.0,
    "core/simulator/drive.py _straight(gear)": 1,  # forward
    "core/simulator/drive.py _arc(gear)": 1,
    "core/simulator/drive.py _turn.arc(gear)": 1,
    "core/geodesy/projection.py ParameterFile.from_map": True,
    "core/values/margins.py margin(factor)": 1.0,
    "core/values/margins.py with_margin(factor)": 1.0,
    "core/matching/consistency.py Seen.slow_times": 1.0,
    "core/matching/problem.py SlowErrors.times[0]": 1.0,
    "core/matching/problem.py SlowErrors.times[1]": 1.0,
    "core/adjustment/preintegration.py InertialLinks.force_times[0]": 1.0,
    "core/adjustment/preintegration.py InertialLinks.force_times[1]": 1.0,
}
"""Factors and directions."""
POINTS: Final = {
    "core/values/margins.py with_margin(digits)": 1,  # decimals of a figure without a margin
    "exporters/reports/quantity_words.py margin_words(factor)": 1.0,
    "exporters/reports/quantity_words.py with_margin_words(factor)": 1.0,
    "exporters/reports/quantity_words.py with_margin_words(digits)": 1,
    "exporters/cloud/point_batches.py PointBatch.return_number": 1,  # LAS counts returns from 1
    "exporters/cloud/point_batches.py PointBatch.returns": 1,
    "exporters/cloud/point_batches.py PointBatch.classification": 1,  # LAS: unclassified
    "exporters/cloud/copc_file.py CopcFormat.scale_m": 0.001,
    "exporters/farm/surface_file.py OpenSurface.read(band)": 1,  # the heights
    "core/runtime/arrays.py scratch_file(buffering)": -1,  # as of open
}
"""A point of which nothing else is known."""
PUBLISHED: Final = {
    # Pingel et al. 2013, as PDAL and lidR use it, with cells of half a metre
    "core/surfaces/ground_filter.py Smrf.cell_m": 0.5,
    "core/surfaces/ground_filter.py Smrf.slope": 0.15,
    "core/surfaces/ground_filter.py Smrf.window_m": 25.0,
    "core/surfaces/ground_filter.py Smrf.threshold_m": 0.15,
    "core/surfaces/ground_filter.py Smrf.scale": 1.25,
    "core/surfaces/terrain.py hillshade(azimuth_deg)": 315.0,  # as gdaldem and QGIS
    "core/surfaces/terrain.py hillshade(altitude_deg)": 45.0,
}
OWN: Final = {
    "app/settings.py CanopySettings.ground_m": 0.2,  # the roughness of ground, and noise
    "app/settings.py CanopySettings.layer_m": 0.5,
    "app/settings.py SeasonSettings.most_rows": 5_000_000,  # files of a hundred megabytes
    "app/settings.py SolveSettings.mask_deg": 15.0,
    "app/settings.py CheckSettings.diameter_m": 0.3,
    "app/settings.py TrafficSettings.cell_m": 0.1,
    "core/accuracy/cloud_at_points.py TargetSearch.diameter_m": 0.3,
    "core/surfaces/outliers.py radius_outliers(radius_m)": 0.5,
    "core/surfaces/outliers.py radius_outliers(fewest)": 3,
    "core/surfaces/outliers.py mean_neighbour_distance(reach_m)": 5.0,
    "core/adjustment/registered_returns.py Registration.patch_m": 1.0,
    "core/matching/ground_registration.py Relief.variance": 0.005,
    "exporters/reports/evaluation_figures.py _rounded(digits)": 4,
    "exporters/reports/svg.py TimeAxis.left": 74.0,
}
LISTED: Final = EVERY_ONE | FACTORS | POINTS | PUBLISHED | OWN

Default = tuple[str, float]


def stated(name: str, node: ast.expr | None) -> Iterator[Default]:
    """The number or truth value of a default, if it is one, and those of a tuple; of a setting, that of its call."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) == "setting":
        node = next((word.value for word in node.keywords if word.arg == "default"), None)
    sign = -1 if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else 1
    value = node.operand if isinstance(node, ast.UnaryOp) else node
    if isinstance(value, ast.Constant) and isinstance(value.value, int | float):
        yield name, sign * value.value
    if isinstance(node, ast.Tuple):
        for k, part in enumerate(node.elts):
            yield from stated(f"{name}[{k}]", part)


def is_constant(field: ast.AnnAssign) -> bool:
    return "ClassVar" in ast.unparse(field.annotation)


def defaults(node: ast.AST, where: str) -> Iterator[Default]:
    """Of the parameters of functions and the fields of classes below a node."""
    for child in ast.iter_child_nodes(node):
        inner = where
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            inner = f"{where}{child.name}."
        if isinstance(child, ast.FunctionDef):
            plain = [*child.args.posonlyargs, *child.args.args]
            pairs = [*zip(reversed(plain), reversed(child.args.defaults), strict=False)]
            for one, default in [*pairs, *zip(child.args.kwonlyargs, child.args.kw_defaults, strict=True)]:
                yield from stated(f"{where}{child.name}({one.arg})", default)
        if isinstance(child, ast.Assign) and ast.unparse(child.value).startswith("partial(setting, "):
            words = {word.arg: word.value for word in child.value.keywords}  # type: ignore[attr-defined]
            yield from stated(f"{where}{ast.unparse(child.targets[0])}(default)", words.get("default"))
        if isinstance(node, ast.ClassDef) and isinstance(child, ast.AnnAssign) and not is_constant(child):
            yield from stated(f"{where}{ast.unparse(child.target)}", child.value)
        yield from defaults(child, inner)


def test_defaults__are_neutral_or_listed() -> None:
    found: dict[str, float] = {}
    for path in files(*PARTS):
        file = path.relative_to(CHECKOUT).as_posix()
        if file not in HELD_BY_PAGES:
            found |= defaults(tree(path), f"{file} ")
    assert len(found) > 100
    assert {name: value for name, value in found.items() if value} == LISTED
