"""The classes that a scan alone shows: the machine, as the run has learned it, and returns without a neighbour."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.implement.machine import Machine
from furrowmap.core.pointclouds.isolated import isolated
from furrowmap.core.pointclouds.placed import unclassified
from furrowmap.core.values.point_classes import PointClass
from furrowmap.core.values.scan import Scan


def classifier(machine: Machine | None) -> Callable[[Scan], NDArray[np.uint8]]:
    """Gives the classes (n,) uint8 of a scan's points: VEHICLE, IMPLEMENT, NOISE, and OTHER for all else."""

    def classify(scan: Scan) -> NDArray[np.uint8]:
        classes = machine.classify(scan) if machine is not None else unclassified(scan)
        classes[isolated(scan) & (classes == PointClass.OTHER)] = PointClass.NOISE
        return classes

    return classify
