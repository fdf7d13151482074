"""The frames of a session as SVG, from the left and from above."""

from html import escape
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.session.frame_tree import BASE, FrameTree
from furrowmap.exporters.reports.svg import element, segment

SHEET_WIDTH: Final = 760.0
VIEW_HEIGHT: Final = 340.0
"""Height of a view, in units of the drawing."""
VIEW_MARGIN: Final = 70.0
LINE_HEIGHT: Final = 16.0
AXIS_LENGTH: Final = 42.0
"""Length of an axis; frames are drawn at a larger scale than the vehicle."""
MIN_EXTENT_M: Final = 0.5
AXIS_COLOURS: Final = ("#c0392b", "#1e8449", "#2456a6")
"""Of x, y and z."""
VIEWS: Final = {"from the left": (0, 2), "from above": (0, 1)}
"""The axes of the vehicle that point right and up in each view."""


def frames_svg(tree: FrameTree) -> str:
    """The drawing as a complete SVG file."""
    views = [part for k, title in enumerate(VIEWS) for part in _view(tree, title, VIEW_MARGIN + k * VIEW_HEIGHT)]
    lines = tree.text.splitlines()
    top = VIEW_MARGIN + len(VIEWS) * VIEW_HEIGHT
    words = [
        f'<text x="10" y="{top + LINE_HEIGHT * k:.0f}" class="tree" xml:space="preserve">{escape(line)}</text>'
        for k, line in enumerate(lines)
    ]
    height = top + LINE_HEIGHT * len(lines) + 10.0
    width = max(SHEET_WIDTH, 20.0 + 6.4 * max(len(line) for line in lines))
    style = (
        "<style>text{font:13px sans-serif;fill:#222}.tree{font:11px monospace}.arm{stroke:#999;stroke-dasharray:4 3}"
        ".point{fill:#222}</style>"
    )
    title = "<title>Frames of the session: x red, y green, z blue</title>"
    parts = "\n".join([title, style, '<rect width="100%" height="100%" fill="#fff"/>', *views, *words])
    size = f'viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{parts}\n</svg>\n'


def _view(tree: FrameTree, title: str, top: float) -> list[str]:
    """The frames that are fixed to the vehicle, in one view."""
    axes = list(VIEWS[title])
    fixed = [frame for frame in tree.frames if frame.name == BASE or _is_fixed(tree, frame.name)]
    poses = [tree.between(frame.name, BASE) for frame in fixed]
    places = np.array([pose.xyz_m for pose in poses])[:, axes]
    low = places.min(axis=0)
    high = places.max(axis=0)
    room = np.array(
        [SHEET_WIDTH - 2 * VIEW_MARGIN - 2 * AXIS_LENGTH - 100.0, VIEW_HEIGHT - VIEW_MARGIN - 2 * AXIS_LENGTH]
    )
    scale = float((room / np.maximum(high - low, MIN_EXTENT_M)).min())
    origin = np.array([VIEW_MARGIN + AXIS_LENGTH, top + VIEW_HEIGHT - VIEW_MARGIN - AXIS_LENGTH]) - low * (
        scale,
        -scale,
    )
    parts = [f'<text x="10" y="{top - 12:.0f}">{title} ({scale:.0f} units per metre)</text>']
    labelled: list[FloatArray] = []
    for frame, pose, place in zip(fixed, poses, places, strict=True):
        here = origin + place * (scale, -scale)
        if np.hypot(*(here - origin)) > 1.0:
            parts.append(segment(*origin, *here, class_="arm"))
        if frame.has_axes:
            parts += [
                segment(
                    *here, *(here + AXIS_LENGTH * pose.rotation[axes, k] * (1.0, -1.0)), stroke=colour, stroke_width=2
                )
                for k, colour in enumerate(AXIS_COLOURS)
            ]
        label = here + np.array([6.0, -6.0])
        while any(abs(label[1] - other[1]) < LINE_HEIGHT and abs(label[0] - other[0]) < 150.0 for other in labelled):
            label = label + np.array([0.0, LINE_HEIGHT])
        labelled.append(label)
        parts.append(element("circle", class_="point", cx=here[0], cy=here[1], r=3))
        parts.append(element("text", frame.name, x=label[0], y=label[1]))
    return parts


def _is_fixed(tree: FrameTree, name: str) -> bool:
    """Whether a frame lies below the vehicle frame and does not move against it."""
    try:
        tree.between(name, BASE)
    except ValueError:
        return False
    return True
