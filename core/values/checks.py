"""A check that values of several arrays share."""

from dataclasses import fields
from typing import Any

import numpy as np


def check_columns(value: Any, increasing: str = "t_s", **widths: int) -> None:
    """Check that a dataclass holds a table: each of its arrays has n rows, and one column strictly increases.

    `widths` are those of arrays (n, width); all others are (n,). Attributes that are no arrays are ignored. ValueError
    if not.
    """
    kind, column = type(value).__name__, getattr(value, increasing)
    for name in (field.name for field in fields(value)):
        array, shape = getattr(value, name), (len(column), *([widths[name]] if name in widths else []))
        if isinstance(array, np.ndarray) and array.shape != shape:
            raise ValueError(f"{kind}.{name} has shape {array.shape}, not {shape}")
    if len(column) > 1 and not bool(np.all(np.diff(column) > 0)):
        raise ValueError(f"{kind}.{increasing} does not increase")
