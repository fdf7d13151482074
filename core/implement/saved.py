"""Saving a detected implement for other sessions of the same machine."""

from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.implement.near_scans import IMAGE_COLUMNS
from furrowmap.core.implement.seen_implement import (
    DepthImages,
    Levels,
    Region,
    SeenImplement,
    SideTemplate,
    SideViewGrid,
)
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.npz import read_npz
from furrowmap.core.values.tool_states import ToolState

FILE_FORM: Final = 2
"""Version of the file format."""


def save_implement(path: Path, implement: SeenImplement) -> None:
    """Write an implement as a NumPy archive; OSError if it cannot be written there."""
    region = implement.region
    template = implement.template
    levels = implement.levels
    images = implement.images
    grid = template.grid
    arrays: dict[str, Any] = {
        "form": np.int64(FILE_FORM),
        "ground": np.array(region.ground),
        "box_m": np.array(region.box_m),
        "columns": region.columns,
        "still_m": region.still_m,
        "turn": np.array([region.begin, region.split, region.clockwise, region.turn_s], np.float64),
        "grid": np.array([grid.x_m, grid.z_m, grid.columns, grid.rows], np.float64),
        "odds": template.odds,
        "levels": np.array([levels.low_m, levels.high_m, levels.hidden, levels.sigma_m, levels.jitter_m], np.float64),
        "usual": np.array([implement.working_m, implement.points, implement.gain]),
        "up_m": images.up_m,
        "down_m": images.down_m,
        "own": images.implement,
        "azimuth_deg": images.azimuth_deg,
    }
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_implement(path: Path) -> SeenImplement:
    """An implement of an earlier session; InputError if the file is unreadable or not of :func:`save_implement`."""
    try:
        return _implement(read_npz(path))
    except (OSError, ValueError, KeyError) as error:
        raise InputError("implement-unreadable", path=path, error=error) from error


def _implement(arrays: dict[str, Any]) -> SeenImplement:
    """The implement in the arrays of a file."""
    if int(arrays["form"]) != FILE_FORM:
        raise ValueError(
            Text("format version {version}, supported is {supported}", version=int(arrays["form"]), supported=FILE_FORM)
        )
    begin, split, clockwise, turn_s = arrays["turn"].tolist()
    x_m, z_m, columns, rows = arrays["grid"].tolist()
    low_m, high_m, hidden, sigma_m, jitter_m = arrays["levels"].tolist()
    working_m, points, gain = arrays["usual"].tolist()
    grid = SideViewGrid(x_m, z_m, int(columns), int(rows))
    shapes = (arrays["odds"].shape, arrays["columns"].shape, arrays["still_m"].shape[1:])
    if shapes != ((grid.columns, grid.rows), (IMAGE_COLUMNS,), (IMAGE_COLUMNS,)):
        raise ValueError(Text("its arrays do not fit each other"))
    seen_images = [arrays[name].shape for name in ("up_m", "down_m", "own")]
    if len(set(seen_images)) > 1 or seen_images[0][1:] != arrays["azimuth_deg"].shape:
        raise ValueError("its images do not fit each other")
    a, b, c = arrays["ground"].tolist()
    x0, x1, y0, y1 = arrays["box_m"].tolist()
    seen = arrays["columns"].astype(bool)
    still_m = arrays["still_m"].astype(np.float32)
    return SeenImplement(
        region=Region((a, b, c), (x0, x1, y0, y1), seen, still_m, int(begin), int(split), bool(clockwise), turn_s),
        template=SideTemplate(grid, arrays["odds"].astype(np.float32)),
        levels=Levels(low_m, high_m, ToolState(int(hidden)), sigma_m, jitter_m),
        working_m=working_m,
        points=points,
        gain=gain,
        images=DepthImages(arrays["up_m"], arrays["down_m"], arrays["own"], arrays["azimuth_deg"]),
    )
