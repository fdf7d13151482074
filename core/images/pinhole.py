"""Between directions of the optical frame and pixels, with Brown distortion."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.values.camera import Camera

UNDISTORT_ITERATIONS: Final = 20
CONVERGED: Final = 1e-12
"""Newton's method has converged when the direction changes by less."""


def project(camera: Camera, xyz_m: FloatArray) -> FloatArray:
    """Pixels (n, 2), also outside the image, of points (n, 3) in the optical frame.

    They are nan behind the camera, and beyond :attr:`~furrowmap.core.values.camera.Camera.widest`.
    """
    points = np.ascontiguousarray(xyz_m, np.float64).reshape(-1, 3)
    pixels: FloatArray = project_points(camera.intrinsics, camera.widest, points)
    return pixels


def unproject(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Directions (n, 3), with z = 1, of pixels (n, 2), by Newton's method.

    They are nan where none within :attr:`~furrowmap.core.values.camera.Camera.widest` has the pixel.
    """
    at = np.ascontiguousarray(pixels, np.float64).reshape(-1, 2)
    directions: FloatArray = unproject_pixels(camera.intrinsics, camera.widest, at)
    return directions


def inside(camera: Camera, pixels: FloatArray, margin_px: float = 0.0) -> NDArray[np.bool_]:
    """(n,) whether pixels (n, 2) lie in the image, between the middles of its outermost pixels, or so near to it."""
    last = np.array([camera.width - 1, camera.height - 1])
    out: NDArray[np.bool_] = np.all((pixels >= -margin_px) & (pixels <= last + margin_px), axis=1)
    return out


@kernel_part(fastmath={"contract"})
def pixel_of(intrinsics, x, y):  # type: ignore[no-untyped-def]
    """Column and row of the direction (x, y, 1)."""
    square = x * x + y * y
    radial = 1.0 + square * (intrinsics[4] + square * (intrinsics[5] + square * intrinsics[6]))
    p1 = intrinsics[7]
    p2 = intrinsics[8]
    bent_x = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
    bent_y = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
    return intrinsics[0] * bent_x + intrinsics[2], intrinsics[1] * bent_y + intrinsics[3]


@kernel()
def project_points(intrinsics, widest, xyz_m):  # type: ignore[no-untyped-def]
    """Kernel of :func:`project`."""
    out = np.full((len(xyz_m), 2), np.nan)
    for i in range(len(xyz_m)):
        z = xyz_m[i, 2]
        if not z > 0.0:
            continue
        x = xyz_m[i, 0] / z
        y = xyz_m[i, 1] / z
        if x * x + y * y <= widest * widest:
            out[i, 0], out[i, 1] = pixel_of(intrinsics, x, y)
    return out


@kernel()
def unproject_pixels(intrinsics, widest, pixels):  # type: ignore[no-untyped-def]
    """Kernel of :func:`unproject`: from the undistorted guess, shortened to lie within the widest angle."""
    out = np.full((len(pixels), 3), np.nan)
    k1 = intrinsics[4]
    k2 = intrinsics[5]
    k3 = intrinsics[6]
    p1 = intrinsics[7]
    p2 = intrinsics[8]
    for i in range(len(pixels)):
        at_x = (pixels[i, 0] - intrinsics[2]) / intrinsics[0]
        at_y = (pixels[i, 1] - intrinsics[3]) / intrinsics[1]
        length = np.sqrt(at_x * at_x + at_y * at_y)
        shorter = min(1.0, 0.9 * widest / length) if length > 0.0 else 1.0
        x = at_x * shorter
        y = at_y * shorter
        found = False
        for _ in range(UNDISTORT_ITERATIONS):
            square = x * x + y * y
            radial = 1.0 + square * (k1 + square * (k2 + square * k3))
            slope = k1 + square * (2.0 * k2 + 3.0 * square * k3)  # of the radial factor by the square
            miss_x = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x) - at_x
            miss_y = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y - at_y
            xx = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
            xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
            yy = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
            determinant = xx * yy - xy * xy
            if not abs(determinant) > 1e-12:
                break
            step_x = (yy * miss_x - xy * miss_y) / determinant
            step_y = (xx * miss_y - xy * miss_x) / determinant
            x = x - step_x
            y = y - step_y
            if abs(step_x) + abs(step_y) < CONVERGED * (1.0 + abs(x) + abs(y)):
                found = x * x + y * y <= widest * widest * (1.0 + 1e-9)
                break
        if found:
            out[i, 0] = x
            out[i, 1] = y
            out[i, 2] = 1.0
    return out
