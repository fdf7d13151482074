"""Eigenfeatures: the shape of the neighbourhood of each point by the eigenvalues of its covariance.

After J. Demantké, C. Mallet, N. David, B. Vallet (2011), Dimensionality based scale selection in 3D lidar point clouds,
ISPRS Archives XXXVIII-5/W12, 97-102, and T. Hackel, J. D. Wegner, K. Schindler (2016), Contour detection in
unstructured 3D point clouds, CVPR, 1610-1618.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.features.neighbours import first_above, sort_into_columns
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

COLUMNS_A_RADIUS: Final = 2.0
"""Narrower columns leave out more of what is outside of the sphere, but have few points at a time."""
NORMAL_AT: Final = np.int64(3)
DIRECTION_AT: Final = np.int64(6)


@dataclass(frozen=True)
class Eigenfeatures:
    """Shapes of n neighbourhoods; nan where one has fewer than three points, or all in one place.

    Attributes:
        eigenvalue_m2: (n, 3) of the covariance, the greatest first.
        normal: (n, 3) unit eigenvector of the least; upwards.
        direction: (n, 3) unit eigenvector of the greatest; upwards.
        count: (n,) number of points, with the point itself.
    """

    eigenvalue_m2: NDArray[np.float32]
    normal: NDArray[np.float32]
    direction: NDArray[np.float32]
    count: NDArray[np.int32]

    @property
    def linearity(self) -> NDArray[np.float32]:
        """(λ1 - λ2) / λ1: 1 on a line."""
        return self._ratio(self.eigenvalue_m2[:, 0] - self.eigenvalue_m2[:, 1])

    @property
    def planarity(self) -> NDArray[np.float32]:
        """(λ2 - λ3) / λ1: 1 on a plane seen all round."""
        return self._ratio(self.eigenvalue_m2[:, 1] - self.eigenvalue_m2[:, 2])

    def at(self, index: NDArray[np.integer]) -> "Eigenfeatures":
        """Those of some neighbourhoods."""
        return Eigenfeatures(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    def _ratio(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        out: NDArray[np.float32] = values / self.eigenvalue_m2[:, 0]
        return out


def neighbourhoods(xyz_m: FloatArray, places_m: FloatArray, radii_m: Sequence[float]) -> list[Eigenfeatures]:
    """Eigenfeatures of the finite points (n, 3) of one tile within increasing radii of finite places (k, 3)."""
    count = np.zeros((len(radii_m), len(places_m)), np.int32)
    shape = np.full((len(radii_m), len(places_m), 9), np.nan, np.float32)
    if len(xyz_m) and len(places_m):
        near = sort_into_columns(xyz_m, radii_m[-1] / COLUMNS_A_RADIUS)
        places = sort_into_columns(places_m, radii_m[-1])
        from_corner = np.ascontiguousarray(places_m - near.corner_m)
        _shapes(
            from_corner, places.order, near.xyz_m, near.starts, near.side_m, *near.across,
            np.asarray(radii_m, np.float64), shape, count,
        )  # fmt: skip
    return [Eigenfeatures(s[:, :3], s[:, 3:6], s[:, 6:], k) for s, k in zip(shape, count, strict=True)]


@kernel(error_model="numpy", fastmath={"contract", "nsz", "reassoc"})
def _shapes(places, order, xyz, starts, side, across, rows, radii, out, count):  # type: ignore[no-untyped-def]
    moments = np.empty(6)
    for shell in range(len(radii)):
        radius = radii[shell]
        square = radius * radius
        for i in order:
            x = places[i, 0]
            y = places[i, 1]
            z = places[i, 2]
            k = sx = sy = sz = xx = yy = zz = xy = xz = yz = 0.0
            first = max(int((x - radius) // side), 0)
            last = min(int((x + radius) // side), across - 1)
            for column in range(first, last + 1):
                aside = max(column * side - x, x - (column + 1) * side, 0.0)
                # Somewhat more, so that rounding loses no neighbour: what is too far away is sorted out below.
                reach = np.sqrt(max(1.000001 * square - aside * aside, 0.0))
                least = max(int((y - reach) // side), 0)
                most = min(int((y + reach) // side), rows - 1)
                for row in range(least, most + 1):
                    begin = starts[column * rows + row]
                    end = starts[column * rows + row + 1]
                    if begin < end and xyz[begin, 2] < z - reach:
                        begin = first_above(xyz, begin, end, z - reach)
                    if begin < end and xyz[end - 1, 2] > z + reach:
                        end = first_above(xyz, begin, end, z + reach)
                    for j in range(begin, end):  # without branches, so that the compiler makes vectors of it
                        a = xyz[j, 0] - x
                        b = xyz[j, 1] - y
                        c = xyz[j, 2] - z
                        near = 1.0 if a * a + b * b + c * c <= square else 0.0
                        k += near
                        sx += near * a
                        sy += near * b
                        sz += near * c
                        xx += near * a * a
                        yy += near * b * b
                        zz += near * c * c
                        xy += near * a * b
                        xz += near * a * c
                        yz += near * b * c
            count[shell, i] = k
            if k >= 3.0:
                moments[0] = xx - sx * sx / k
                moments[1] = yy - sy * sy / k
                moments[2] = zz - sz * sz / k
                moments[3] = xy - sx * sy / k
                moments[4] = xz - sx * sz / k
                moments[5] = yz - sy * sz / k
                eigen(moments, k, out[shell, i])


@kernel()
def eigen(moments, k, out):  # type: ignore[no-untyped-def]
    """Eigenvalues, the greatest first, and eigenvectors of the least and the greatest, into `out` (9,).

    `moments` are xx, yy, zz, xy, xz, yz summed over k points. Closed form after O. K. Smith (1961), Eigenvalues of a
    symmetric 3 x 3 matrix, Communications of the ACM 4, 168.
    """
    a = moments[0] / k
    b = moments[1] / k
    c = moments[2] / k
    d = moments[3] / k
    e = moments[4] / k
    f = moments[5] / k
    mean = (a + b + c) / 3.0
    if not mean > 0.0:
        return
    a0 = a - mean
    b0 = b - mean
    c0 = c - mean
    p = np.sqrt((a0 * a0 + b0 * b0 + c0 * c0 + 2.0 * (d * d + e * e + f * f)) / 6.0)
    if p < 1e-12 * mean:
        out[0] = mean
        out[1] = mean
        out[2] = mean
        out[3] = 0.0
        out[4] = 0.0
        out[5] = 1.0
        out[6] = 1.0
        out[7] = 0.0
        out[8] = 0.0
        return
    half = (a0 * (b0 * c0 - f * f) - d * (d * c0 - f * e) + e * (d * f - b0 * e)) / (2.0 * p * p * p)
    angle = np.arccos(min(1.0, max(-1.0, half))) / 3.0
    greatest = mean + 2.0 * p * np.cos(angle)
    least = max(mean + 2.0 * p * np.cos(angle + 2.0943951023931953), 0.0)
    out[0] = greatest
    out[1] = max(3.0 * mean - greatest - least, least)
    out[2] = least
    if out[1] - out[2] > 1e-7 * greatest:
        _vector(a, b, c, d, e, f, least, out, NORMAL_AT)
        if greatest - out[1] > 1e-7 * greatest:
            _vector(a, b, c, d, e, f, greatest, out, DIRECTION_AT)
        else:
            _beside(out, NORMAL_AT, DIRECTION_AT)
    else:  # any vector at right angles to the direction is a normal
        _vector(a, b, c, d, e, f, greatest, out, DIRECTION_AT)
        _beside(out, DIRECTION_AT, NORMAL_AT)


@kernel()
def _vector(a, b, c, d, e, f, value, out, at):  # type: ignore[no-untyped-def]
    """Unit eigenvector for an eigenvalue, upwards: the longest cross product of two rows."""
    ax = a - value
    by = b - value
    cz = c - value
    x1 = d * f - e * by
    y1 = e * d - ax * f
    z1 = ax * by - d * d
    x2 = d * cz - e * f
    y2 = e * e - ax * cz
    z2 = ax * f - d * e
    x3 = by * cz - f * f
    y3 = f * e - d * cz
    z3 = d * f - by * e
    n1 = x1 * x1 + y1 * y1 + z1 * z1
    n2 = x2 * x2 + y2 * y2 + z2 * z2
    n3 = x3 * x3 + y3 * y3 + z3 * z3
    if n2 > n1 and n2 >= n3:
        x1 = x2
        y1 = y2
        z1 = z2
        n1 = n2
    elif n3 > n1:
        x1 = x3
        y1 = y3
        z1 = z3
        n1 = n3
    scale = 1.0 / np.sqrt(n1) * (-1.0 if z1 < 0.0 else 1.0)
    out[at] = x1 * scale
    out[at + 1] = y1 * scale
    out[at + 2] = z1 * scale


@kernel()
def _beside(out, given, at):  # type: ignore[no-untyped-def]
    """A unit vector at right angles to that at `given`, as level as can be."""
    x = out[given]
    y = out[given + 1]
    flat = np.sqrt(x * x + y * y)
    if flat > 1e-3:
        out[at] = -y / flat
        out[at + 1] = x / flat
        out[at + 2] = 0.0
    else:
        out[at] = 1.0
        out[at + 1] = 0.0
        out[at + 2] = 0.0
