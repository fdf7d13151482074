"""Arrays that the kernels of readers fill with the returns of packets."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.scan import Scan


class ReturnColumns(NamedTuple):
    """Room for returns, in arrays as those of a :class:`~furrowmap.core.values.scan.Scan`."""

    t_s: NDArray[np.float64]
    xyz_m: NDArray[np.float32]
    intensity: NDArray[np.uint8]
    laser: NDArray[np.uint8]
    column: NDArray[np.uint16]
    return_number: NDArray[np.uint8]
    returns: NDArray[np.uint8]

    @classmethod
    def empty(cls, room: int) -> "ReturnColumns":
        """Room for so many. Each array has memory of its own: one for several would come fresh from the system."""
        intensity, laser, number, returns = (np.empty(room, np.uint8) for _ in range(4))
        column = np.empty(room, np.uint16)
        return cls(np.empty(room), np.empty((room, 3), np.float32), intensity, laser, column, number, returns)

    def scan(self, count: int, lasers: int) -> Scan:
        """The first of them as a scan of a scanner with so many lasers."""
        arrays: dict[str, Any] = {name: values[:count] for name, values in self._asdict().items()}
        return Scan(0, **arrays, lasers=lasers)
