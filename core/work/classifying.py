"""Classification within a scan: machine and isolated returns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.isolated import isolated
from furrowmap.core.pointclouds.placed import unclassified
from furrowmap.core.values.scan import PointClass, Scan
from furrowmap.core.work.machine import Machine


def classifier(machine: Machine | None) -> Callable[[Scan], NDArray[np.uint8]]:
    """A function from a scan to the classes (n,) uint8 of its points: VEHICLE, IMPLEMENT, NOISE, else OTHER."""

    def classify(scan: Scan) -> NDArray[np.uint8]:
        classes = machine.classify(scan) if machine is not None else unclassified(scan)
        classes[isolated(scan) & (classes == PointClass.OTHER)] = PointClass.NOISE
        return classes

    return classify
