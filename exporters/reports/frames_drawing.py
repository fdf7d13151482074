"""The frames of a vehicle as a drawing: from the side and from above, with the axes of each sensor."""

from __future__ import annotations

from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.session.frames import BASE, FrameTree

FloatArray = NDArray[np.float64]

WIDTH: Final = 760.0
PANEL: Final = 340.0
"""Height of a view, in units of the drawing."""
MARGIN: Final = 70.0
LINE: Final = 16.0
AXIS: Final = 42.0
"""Length of an axis; frames are drawn at a larger scale than the vehicle."""
LEAST_M: Final = 0.5
COLOURS: Final = ("#c0392b", "#1e8449", "#2456a6")
"""Of x, y and z."""
VIEWS: Final = {"from the left": (0, 2), "from above": (0, 1)}
"""The axes of the vehicle that point right and up in each view."""


def frames_svg(tree: FrameTree) -> str:
    """The drawing as a complete SVG file."""
    views = [_view(tree, title, axes, MARGIN + k * PANEL) for k, (title, axes) in enumerate(VIEWS.items())]
    lines = tree.text.splitlines()
    top = MARGIN + len(VIEWS) * PANEL
    words = [
        f'<text x="10" y="{top + LINE * k:.0f}" class="tree" xml:space="preserve">{escape(line)}</text>'
        for k, line in enumerate(lines)
    ]
    height = top + LINE * len(lines) + 10.0
    widest = max(WIDTH, 20.0 + 6.4 * max(len(line) for line in lines))
    style = (
        "<style>text{font:13px sans-serif;fill:#222}.tree{font:11px monospace}.arm{stroke:#999;stroke-dasharray:4 3}"
        ".point{fill:#222}</style>"
    )
    title = "<title>Frames of the session: x red, y green, z blue</title>"
    parts = "\n".join([title, style, '<rect width="100%" height="100%" fill="#fff"/>', *views, *words])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {widest:.0f} {height:.0f}" width="{widest:.0f}" '
        f'height="{height:.0f}">\n{parts}\n</svg>\n'
    )


def _view(tree: FrameTree, title: str, axes: tuple[int, int], top: float) -> str:
    """The frames that are fixed to the vehicle, in one view."""
    fixed = [frame for frame in tree.frames if frame.name == BASE or _is_fixed(tree, frame.name)]
    poses = [tree.between(frame.name, BASE) for frame in fixed]
    places = np.array([pose.xyz_m for pose in poses])[:, axes]
    low, high = places.min(axis=0), places.max(axis=0)
    room = np.array([WIDTH - 2 * MARGIN - 2 * AXIS - 100.0, PANEL - MARGIN - 2 * AXIS])
    scale = float((room / np.maximum(high - low, LEAST_M)).min())
    origin = np.array([MARGIN + AXIS, top + PANEL - MARGIN - AXIS])

    def at(place: FloatArray) -> FloatArray:
        out: FloatArray = origin + (place - low) * (scale, -scale)
        return out

    base = at(np.zeros(2))
    parts = [f'<text x="10" y="{top - 12:.0f}">{title} ({scale:.0f} units per metre)</text>']
    labelled: list[FloatArray] = []
    for frame, pose, place in zip(fixed, poses, places, strict=True):
        here = at(place)
        if np.hypot(*(here - base)) > 1.0:
            parts.append(_line(base, here, 'class="arm"'))
        if frame.has_axes:
            parts += [
                _line(
                    here,
                    here + AXIS * pose.rotation[list(axes), k] * (1.0, -1.0),
                    f'stroke="{colour}" stroke-width="2"',
                )
                for k, colour in enumerate(COLOURS)
            ]
        label = here + np.array([6.0, -6.0])
        while any(abs(label[1] - other[1]) < LINE and abs(label[0] - other[0]) < 150.0 for other in labelled):
            label = label + np.array([0.0, LINE])
        labelled.append(label)
        parts.append(f'<circle class="point" cx="{here[0]:.1f}" cy="{here[1]:.1f}" r="3"/>')
        parts.append(f'<text x="{label[0]:.1f}" y="{label[1]:.1f}">{escape(frame.name)}</text>')
    return "\n".join(parts)


def _is_fixed(tree: FrameTree, name: str) -> bool:
    """Whether a frame lies below the vehicle frame and does not move against it."""
    try:
        tree.between(name, BASE)
    except ValueError:
        return False
    return True


def _line(first: FloatArray, last: FloatArray, more: str) -> str:
    return f'<line x1="{first[0]:.1f}" y1="{first[1]:.1f}" x2="{last[0]:.1f}" y2="{last[1]:.1f}" {more}/>'
