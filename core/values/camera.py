"""A camera: its image geometry and its mounting on the vehicle."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.rotation import Mounting

PINHOLE: Final = ("fx", "fy", "cx", "cy")
"""Names of focal lengths and principal point."""
DISTORTION: Final = ("k1", "k2", "k3", "p1", "p2")
"""Names of the distortion coefficients, as OpenCV has them."""
MAX_TANGENT: Final = 20.0
"""Largest tangent of the angle off the optical axis that is considered (87°)."""

COLMAP_MODELS: Final = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
"""Camera models of COLMAP that are Brown distortion or less, and the order of their parameters."""
COLMAP_MIDDLE: Final = 0.5
"""COLMAP counts pixels from the corner of the image: its (0.5, 0.5) is the middle of the top left pixel."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with Brown distortion, in OpenCV's convention.

    Pixel (0, 0) is the middle of the top left pixel. The optical frame has x right in the image, y down and z along the
    view. A direction (x, y, 1) has the pixel ``(fx·x' + cx, fy·y' + cy)`` with
    ``x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)`` and
    ``y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y`` (Brown 1966).

    Attributes:
        width, height: of the images, in pixels.
        fx, fy: focal lengths in pixels.
        k1, k2, k3: radial distortion.
        p1, p2: tangential distortion.
        xyz_m: the projection centre in the vehicle frame.
        rpy_deg: roll, pitch, yaw of the optical frame in the vehicle frame, as in
            :class:`~furrowmap.core.values.rotation.Mounting`.
        shutter_delay_s: middle of the exposure after the time stated for an image.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shutter_delay_s: float = 0.0

    def __post_init__(self) -> None:
        numbers = (*self.intrinsics, *self.xyz_m, *self.rpy_deg, self.shutter_delay_s)
        if not bool(np.all(np.isfinite(numbers))) or min(self.fx, self.fy, self.width, self.height) <= 0:
            raise ValueError(f"a camera needs finite numbers, and a size and focal lengths above 0: {self}")

    @property
    def mounting(self) -> Mounting:
        """Where its optical frame is in the vehicle frame."""
        return Mounting(self.xyz_m, self.rpy_deg)

    @property
    def intrinsics(self) -> FloatArray:
        """(9,): fx, fy, cx, cy, k1, k2, k3, p1, p2, as the kernels take them."""
        return np.array(
            [self.fx, self.fy, self.cx, self.cy, self.k1, self.k2, self.k3, self.p1, self.p2], dtype=np.float64
        )

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) camera matrix, as OpenCV takes it."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> FloatArray:
        """(5,): k1, k2, p1, p2, k3, as OpenCV takes them."""
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3])

    @cached_property
    def widest(self) -> float:
        """Tangent of the largest angle off the axis for which pixels move outwards with the angle.

        Beyond it the polynomial folds back, and would put what is far outside the view into the image.
        """
        # Roots of 1 + 3 k1 r² + 5 k2 r⁴ + 7 k3 r⁶ by the inverse of r², whose first coefficient is never zero.
        inverse = np.roots([1.0, 3.0 * self.k1, 5.0 * self.k2, 7.0 * self.k3])
        turning = inverse[np.isreal(inverse) & (inverse.real > MAX_TANGENT**-2)].real
        return float(min([MAX_TANGENT, *np.sqrt(1.0 / turning)]))

    def reduced(self, factor: int) -> "Camera":
        """The camera of images whose pixels are the means of `factor` × `factor` of its own; a rest is cut off."""
        shift = 0.5 * (factor - 1)
        return replace(
            self,
            width=self.width // factor,
            height=self.height // factor,
            fx=self.fx / factor,
            fy=self.fy / factor,
            cx=(self.cx - shift) / factor,
            cy=(self.cy - shift) / factor,
        )

    @classmethod
    def from_colmap(cls, size: tuple[int, int], model: str, params: tuple[float, ...]) -> "Camera":
        """The camera of a line of COLMAP's `cameras.txt`; the model is a key of :data:`COLMAP_MODELS`.

        ValueError if the model or the number of parameters is another, or k4 to k6 are not zero.
        """
        names = COLMAP_MODELS.get(model)
        if names is None:
            raise ValueError(f"camera model {model!r} is none of {', '.join(COLMAP_MODELS)}")
        if len(params) != len(names):
            raise ValueError(f"{model} has the {len(names)} parameters {', '.join(names)}, not {len(params)}")
        stated = dict(zip(names, params, strict=True))
        if any(stated.pop(name, 0.0) for name in ("k4", "k5", "k6")):
            raise ValueError("k4, k5 and k6 of FULL_OPENCV must be 0: Brown distortion has no denominator")
        focal = stated.pop("f", None)
        if focal is not None:
            stated |= {"fx": focal, "fy": focal}
        stated["cx"] -= COLMAP_MIDDLE
        stated["cy"] -= COLMAP_MIDDLE
        return cls(*size, **stated)  # type: ignore[arg-type]
