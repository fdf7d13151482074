"""The colours of ground worked, the same on the live page, in reports, on maps, in QGIS and in QField.

Those of ground lie at 3:1 or more from what is below them (WCAG 2.2, criterion 1.4.11) and are told apart without red,
green or blue cones.
"""

from typing import Final

WORKED_COLOUR: Final = "#2e8b57"
OVERLAP_COLOUR: Final = "#c25100"
MISSED_COLOUR: Final = "#7b1fa2"
NOT_SEEN_COLOUR: Final = "#5f6b73"
PASS_RAMP: Final = ("#b5dcc4", WORKED_COLOUR, "#123f29")
"""From the first pass to the last: shades of ground worked."""
TOOL_DOWN_COLOUR: Final = "#5a3dff"
TOOL_UP_COLOUR: Final = "#2f7fb8"
TOOL_UNKNOWN_COLOUR: Final = "#6e6e6e"
BOUNDARY_COLOUR: Final = "#1f2a30"

DAY: Final = {
    "worked": WORKED_COLOUR,
    "overlap": OVERLAP_COLOUR,
    "missed": MISSED_COLOUR,
    "not-seen": NOT_SEEN_COLOUR,
    "tool-down": TOOL_DOWN_COLOUR,
    "tool-up": TOOL_UP_COLOUR,
    "boundary": BOUNDARY_COLOUR,
    "on-tool": "#ffffff",
    "vehicle": "#0b3d91",
    "ground": "#f3efe6",
    "paper": "#ffffff",
    "ink": "#101814",
    "soft": "#46524c",
    "line": "#8a958f",
    "alarm": "#b00020",
    "alarm-ink": "#ffffff",
    "alarm-text": "#b00020",
    "note": "#ffe08a",
    "note-ink": "#1c1600",
}
"""Of the live page in daylight, by the names of its style sheet."""

NIGHT: Final = {
    "worked": "#1f9c86",
    "overlap": "#ffab40",
    "missed": "#c77dff",
    "not-seen": "#c8d0d4",
    "boundary": "#e6efe9",
    "tool-down": "#7542ff",
    "tool-up": "#6fb4e4",
    "on-tool": "#000000",
    "vehicle": "#7fb2ff",
    "ground": "#151a17",
    "paper": "#0b0f0d",
    "ink": "#e6efe9",
    "soft": "#9fb0a6",
    "line": "#66736c",
    "alarm": "#a3001d",
    "alarm-ink": "#ffffff",
    "alarm-text": "#ff8a9a",
    "note": "#4a3c00",
    "note-ink": "#ffe9a8",
}
"""The same at night."""
