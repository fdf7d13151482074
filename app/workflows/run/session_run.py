"""Running a session with all that it states: the run, and the tools on its result."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.workflows.run.run import run_to_folder
from furrowmap.workflows.run.tools import RunTool

if TYPE_CHECKING:
    from furrowmap.results import Result


def run(
    session: str | Path,
    out: str | Path | None = None,
    *,
    overwrite: bool = False,
    resume: bool = False,
    within: str | Path | None = None,
    progress: Progress = silent,
) -> Result:
    """Run a session and write its products into a folder.

    Products of the same recordings in the folder are replaced, whatever else the session names or sets: the same files
    of the scanner, byte for byte, or without a scanner the same positions.

    Args:
        out: the folder, made if it does not exist; by default SESSION_result beside the session file.
        resume: use what a killed run into the same folder found by scan matching, if session and recordings are the
            same.
        within: a file with polygons, or task data: cloud, surfaces and parcels hold what lies in them alone; instead of
            `[field] within`.

    Raises:
        FurrowmapError: if the session does not make a cloud, or the folder cannot be written to.
    """
    file = Path(session)
    folder = Path(out) if out is not None else resolved(file).parent / f"{file.stem}_result"
    opened = open_session(file)
    if within is not None:
        opened = opened.within(Path(within))
    run_to_folder(opened, folder, session_tools(opened), overwrite=overwrite, resume=resume, progress=progress)
    return _result(folder)


def run_opened(
    opened: OpenSession, folder: Path, *, overwrite: bool, resume: bool, progress: Progress = silent
) -> Result:
    """Run an open session; arguments and errors as :func:`run`."""
    run_to_folder(opened, folder, session_tools(opened), overwrite=overwrite, resume=resume, progress=progress)
    return _result(folder)


def _result(folder: Path) -> Result:
    from furrowmap.results import open_result

    return open_result(folder)


def session_tools(opened: OpenSession) -> list[RunTool]:
    """The tools that a session asks for, in the order in which they judge its result."""
    tools: list[RunTool] = []
    session = opened.session
    if session.camera is not None:
        from furrowmap.workflows.run.colour_tool import ColourTool

        tools.append(ColourTool())
    if session.parcels is not None:
        from furrowmap.workflows.run.parcel_tool import ParcelTool

        tools.append(ParcelTool(opened))
    if opened.inputs.ground_control is not None:
        from furrowmap.workflows.run.control_tool import ControlTool

        tools.append(ControlTool(opened))
    if opened.inputs.check_points is not None or opened.inputs.ground_control is not None:
        from furrowmap.workflows.run.check_tool import CheckTool

        tools.append(CheckTool(opened))
    if session.features is not None:
        from furrowmap.workflows.run.feature_tool import FeatureTool

        tools.append(FeatureTool(session.features))
    from furrowmap.workflows.run.live_tool import LiveTool

    return [*tools, LiveTool(opened), ItemTool()]


class ItemTool(RunTool):
    """Describes the products as a STAC item."""

    def preload(self) -> None:
        """Import what writes the item."""
        import furrowmap.exporters.exchange.stac  # noqa: F401

    def describe(self, report: dict[str, Any]) -> None:
        """Write the item."""
        from furrowmap.exporters.exchange.stac import write_item
        from furrowmap.exporters.files.result_folder import ITEM

        write_item(self.folder / ITEM, report)
