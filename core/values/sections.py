"""Sections of an implement: parts across its width, and how the implement hangs on the vehicle."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Section:
    """A section: the place of its middle in the frame of the implement, x forward and y to the left, and its width."""

    name: str
    x_m: float
    y_m: float
    width_m: float


@dataclass(frozen=True)
class Link:
    """How a body follows the one before it.

    Attributes:
        joint_m: from the origin of the body before, x forward and y to the left in its frame.
        drawbar_m: from the joint back to the origin of this body, which follows the joint as an axle that does not slip
            sideways; 0 for a body that is mounted rigidly, whose origin is the joint.
    """

    joint_m: tuple[float, float]
    drawbar_m: float
