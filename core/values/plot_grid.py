"""Sizes and numbering of the plots of a trial."""

from dataclasses import MISSING, dataclass
from typing import Literal

from furrowmap.core.runtime.options import OptionSettings, setting


@dataclass(frozen=True)
class PlotGrid(OptionSettings):
    """A grid of plots.

    Columns follow each other along the base line, rows beside it. A plot's length is along the base line.

    Attributes:
        rows: Number of plots across the base line.
        columns: Number of plots along the base line.
        length_m: Length of a plot along the base line [default: from the two corners].
        width_m: Width of a plot across the base line.
        alley_m: Distance between columns.
        path_m: Distance between rows.
        side: Side of the base line on which the rows lie, looking along it.
        along: Whether numbers run along rows (from column to column) or along columns.
        serpentine: serpentine: every second row or column is numbered backwards.
        first: Number of the first plot.
        block: Whether rows or columns are blocks (replicates).
        block_size: Number of rows or columns in a block.
        by_block: Restart the numbers in each block: 101, 102, … 201.
    """

    rows: int = setting("--rows", "N", default=MISSING, required=True, minimum=1)
    columns: int = setting("--columns", "N", default=MISSING, required=True, minimum=1)
    length_m: float | None = setting("--length", "METRES", default=MISSING, above=0, label="Length of a plot")
    width_m: float = setting("--width", "METRES", default=MISSING, required=True, above=0, label="Width of a plot")
    alley_m: float = setting("--alley", "METRES", default=0.0, minimum=0)
    path_m: float = setting("--path", "METRES", default=0.0, minimum=0)
    side: Literal["left", "right"] = setting("--side", default="left", choices=("left", "right"))
    along: Literal["rows", "columns"] = setting(
        "--along", default="rows", choices=("rows", "columns"), label="Numbers along"
    )
    serpentine: bool = setting("--numbering", default=False, choices={"serpentine": True, "straight": False})
    first: int = setting("--first", "N", default=1, label="First number")
    block: Literal["rows", "columns"] | None = setting(
        "--blocks", choices={"none": None, "rows": "rows", "columns": "columns"}
    )
    block_size: int = setting("--block-size", "N", default=1, minimum=1, label="Rows or columns of a block")
    by_block: bool = setting("--by-block", default=False, label="Number each block anew")
