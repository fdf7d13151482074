"""The frames of a session."""

from pathlib import Path

from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.session.frame_tree import FrameTree, frame_tree
from furrowmap.core.session.opened import resolve, with_phase_centre
from furrowmap.core.session.session_file import load_session
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.reports.frame_drawing import frames_svg


def frames(session: str | Path, svg: str | Path | None = None) -> FrameTree:
    """The frames of a session as a tree; the recordings are not read, and need not be there.

    Args:
        svg: file for a drawing; nothing is written without it.

    Raises:
        InputError: if the session is invalid.
        RefusedError: if its map frame is.
    """
    path = Path(session)
    stated = load_session(path)
    names = (stated.crs.parameters, stated.crs.geoid_grid, stated.antenna.antex if stated.antenna is not None else None)
    parameters, geoid_grid, antex = (resolve(path, name) if name is not None else None for name in names)
    stated = with_phase_centre(stated, antex)
    tree = frame_tree(stated, map_frame(stated.crs, parameters, geoid_grid))
    if svg is not None:
        with atomic_output(Path(svg)) as unfinished:
            unfinished.write_text(frames_svg(tree), encoding="utf-8")
    return tree
