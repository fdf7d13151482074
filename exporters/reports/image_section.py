"""The section of a report page that images of a camera add: their adjustment, and what it found."""

from __future__ import annotations

from collections.abc import Iterator

from furrowmap.core.images.aiding import ImageAid
from furrowmap.exporters.reports.page_parts import remark, section, table


def image_sections(aid: ImageAid | None) -> Iterator[str]:
    """The adjustment of the images; nothing without one."""
    if aid is not None:
        yield section("Poses adjusted by images", _block(aid))


def _block(aid: ImageAid) -> str:
    told, camera = aid.plain(), aid.calibration()
    rows = [
        ("images", str(told["images"])),
        ("points", f"{told['points']:,}, in {told['observations_used']:,} of {told['observations']:,} views"),
        ("reprojection error (RMS)", f"{told['reprojection_rms_px']:.2f} pixels"),
        ("mounting of the camera, correction", _angles(camera["correction_deg"], camera["sigma_deg"])),
        (
            "shutter delay",
            f"{1000 * camera['shutter_delay_s']:.2f} ± {1000 * camera['shutter_delay_sigma_s']:.2f} ms",
        ),
    ]
    names = ("easting", "northing", "height")
    for name, shift, sigma in zip(names, told["shift_m"], told["shift_sigma_m"], strict=True):
        rows.append((f"shift of the block, {name}", f"{1000 * shift:.1f} ± {1000 * sigma:.1f} mm"))
    for kind, unit, scale, axes in (("m", " mm", 1000.0, names), ("deg", "°", 1.0, ("roll", "pitch", "heading"))):
        for name, before, after in zip(axes, told[f"sigma_before_{kind}"], told[f"sigma_after_{kind}"], strict=True):
            digits = 1 if kind == "m" else 4
            values = f"{scale * before:.{digits}f}{unit} before, {scale * after:.{digits}f}{unit} after"
            rows.append((f"sigma of {name}", values))
    for point in told["control_points"]:
        off = ", ".join(f"{1000 * value:.1f}" for value in point["off_m"])
        rows.append(
            (
                f"control point {point['name']}",
                f"in {point['images']} images, {point['residual_px']:.2f} pixels; adjusted minus surveyed {off} mm",
            )
        )
    note = (
        "Points that several images show take part in the adjustment of positions and IMU. Standard deviations are "
        "medians. Without control points, what is common to all images stays as the positions have it."
    )
    return f'<div class="scroll">{table(("", ""), rows)}</div>{remark(note)}'


def _angles(values: list[float], sigmas: list[float]) -> str:
    """Angles about the vehicle's x, y and z with their standard deviations."""
    return ", ".join(f"{value:.3f} ± {sigma:.3f}°" for value, sigma in zip(values, sigmas, strict=True))
