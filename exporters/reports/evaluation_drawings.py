"""Drawings of GNSS evaluations as SVG: errors over time, and tracks."""

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Final

import numpy as np
from markupsafe import Markup

from furrowmap.core.accuracy.evaluation import Evaluation
from furrowmap.core.geodesy.longitudes import unwrapped_deg
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.earth import SEMI_MAJOR_M
from furrowmap.core.values.gnss import Fix
from furrowmap.exporters.reports.drawings import fix_colour
from furrowmap.exporters.reports.svg import WIDTH, Axis, Sheet, TimeAxis, curve, drawing, rectangle

MAX_TRACK_POINTS: Final = 4000
"""Most points of a track on the map of several services."""
ERRORS: Final[Mapping[Text, Callable[[FloatArray], FloatArray]]] = {
    Text("Horizontal error (2D)"): lambda error_m: np.hypot(error_m[:, 0], error_m[:, 1]),
    Text("X, towards east"): lambda error_m: error_m[:, 0],
    Text("Y, towards north"): lambda error_m: error_m[:, 1],
    Text("Z, up"): lambda error_m: error_m[:, 2],
}

FIX_WORDS: Final[Mapping[str, Words]] = {
    "fixed": Text("fixed"),
    "float": Text("float"),
    "ppp": Text("ppp"),
    "dgps": Text("dgps"),
    "single": Text("single"),
}
"""Words for kinds of fix; others stay as they are named."""


def fix_words(label: str) -> Words:
    """A kind of fix for people."""
    return FIX_WORDS.get(label, label)


def known_errors(found: Evaluation) -> list[Text]:
    """The names of the errors that are known at some epoch."""
    return [title for title, values in ERRORS.items() if np.isfinite(values(found.matched.error_m)).any()]


def fix_kinds(found: Evaluation) -> list[tuple[str, Words]]:
    """Colour and name of the kinds of fix of a log."""
    return [(fix_colour(code), fix_words(Fix(code).label)) for code in np.unique(found.fix).tolist()]


def error_graph(evaluations: Mapping[str, Evaluation], title: Text, colours: Mapping[str, str] | None = None) -> Markup:
    """One of :data:`ERRORS` over time, in the colours of the services; one alone has a bar of its kinds of fix."""
    share, top, bottom = (0.99, 20.0, 150.0) if colours is None else (0.98, 10.0, 180.0)
    series = {name: ERRORS[title](found.matched.error_m) for name, found in evaluations.items()}
    known = np.abs(np.concatenate([values[np.isfinite(values)] for values in series.values()]))
    reach = max(1e-3, float(np.quantile(known, share)) * 1.15) if len(known) else 1.0
    times = [found.matched.t_s for found in evaluations.values()]
    time = TimeAxis(float(min(t_s[0] for t_s in times)), float(max(t_s[-1] for t_s in times)))
    axis = Axis(0.0 if title == next(iter(ERRORS)) else -reach, reach, bottom, top)
    parts = []
    if colours is None:
        (found,) = evaluations.values()
        for a, b in pairwise(_edges(found)):
            left, right = time.at(found.matched.t_s[[a, b - 1]])
            parts.append(rectangle(left, 0, right + 0.5, 12, fill=fix_colour(int(found.fix[a]))))
    parts += axis.grid(time.left, lambda v: f"{v:.3g} m")
    for name, found in evaluations.items():
        parts += [f'<g class="service" stroke="{colours[name]}">'] if colours is not None else []
        for a, b in pairwise(found.matched.unbroken):
            parts += curve(time.at(found.matched.t_s[a:b]), np.clip(axis.at(series[name][a:b]), top, bottom))
        parts += ["</g>"] if colours is not None else []
    parts += time.labels(bottom)
    about = Text("{error} over time", error=title)
    if colours is not None:
        about = Text("{error} of each service over time", error=title)
    return drawing(WIDTH, bottom + 38.0, parts, about)


def track_map(found: Evaluation) -> Markup:
    """The track of a log by its kinds of fix over that of the reference."""
    test = found.matched.test_m[:, :2]
    reference = found.matched.reference_m[:, :2]
    sheet = _sheet(np.concatenate([test, reference]))
    parts = [sheet.line(reference[a:b], "way") for a, b in pairwise(found.matched.unbroken) if b - a > 1]
    edges = _edges(found)
    changes = set(edges[1:-1]) - set(found.matched.unbroken)  # a line continues where only the kind of fix changes
    for a, b in pairwise(edges):
        part = np.clip(test[a : b + 1 if b in changes else b], sheet.box_m[:2], sheet.box_m[2:])
        if len(part) > 1:
            parts.append(sheet.line(part, "track", stroke=fix_colour(int(found.fix[a]))))
    return sheet.svg(parts, Text("Trajectories: the reference in indigo, the test by its kind of fix"))


def services_map(evaluations: Mapping[str, Evaluation], colours: Mapping[str, str]) -> Markup:
    """The tracks of several services over that of the reference."""
    first = next(iter(evaluations.values()))
    lon = float(first.lon_deg[0])
    lat = float(first.lat_deg[0])
    scale = np.radians(1.0) * SEMI_MAJOR_M * np.array([math.cos(math.radians(lat)), 1.0])
    tracks = {
        name: np.column_stack([unwrapped_deg(found.lon_deg, lon) - lon, found.lat_deg - lat]) * scale
        for name, found in evaluations.items()
    }
    references = {name: tracks[name] - found.matched.error_m[:, :2] for name, found in evaluations.items()}
    sheet = _sheet(np.concatenate([*tracks.values(), *references.values()]))
    parts: list[str] = []
    for name, found in evaluations.items():
        step = -(-len(tracks[name]) // MAX_TRACK_POINTS)
        for a, b in pairwise(found.matched.unbroken):
            if b - a > 1:
                parts.insert(0, sheet.line(references[name][a:b:step], "way"))
                shown = np.clip(tracks[name][a:b:step], sheet.box_m[:2], sheet.box_m[2:])
                parts.append(sheet.line(shown, "track", stroke=colours[name]))
    return sheet.svg(parts, Text("Tracks of the services and of the reference"))


def _sheet(en_m: FloatArray) -> Sheet:
    """A sheet for places (n, 2), without the outermost."""
    west, south = np.quantile(en_m, 0.001, axis=0).tolist()
    east, north = np.quantile(en_m, 0.999, axis=0).tolist()
    margin = max(0.05 * max(east - west, north - south), 0.05)
    return Sheet((west - margin, south - margin, east + margin, north + margin))


def _edges(found: Evaluation) -> list[int]:
    """Indices at which the kind of fix changes or a gap begins, with both ends."""
    cuts = np.flatnonzero(np.diff(found.fix) != 0) + 1
    return sorted({0, *cuts.tolist(), *found.matched.unbroken})
