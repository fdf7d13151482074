"""Bundle adjustment of images with what GNSS and IMU know of their poses.

Points that several images show are observations of the poses at which these were taken. What GNSS and IMU say of the
poses enters as the joint covariance of their errors at nodes in time: two neighbouring images are known against each
other to millimetres where both may be off by decimetres together, which a standard deviation for each image would not
say. The result is that of one adjustment of everything, linearised at the poses before. Unknowns are the errors of the
poses at the nodes, the camera's boresight and the delay of its shutter; the points are eliminated from each round's
normal equations (Schur complement; Triggs et al. 2000, Bundle adjustment - a modern synthesis).
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import huber_weight
from furrowmap.core.adjustment.correlated_prior import covariance_after, root_of, solved
from furrowmap.core.adjustment.knots import POSE, ROTATION
from furrowmap.core.adjustment.preintegration import cross_matrix
from furrowmap.core.images.image_frames import FramePoses
from furrowmap.core.images.pinhole import project, unproject
from furrowmap.core.images.ties import Ties
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import Trajectory

DELAY: Final = 3
"""Column behind the boresight, a rotation vector about the vehicle's axes."""
CAMERA_UNKNOWNS: Final = 4
"""Unknowns beside the errors of the poses."""
CAMERA_SIGMAS: Final = np.array([*np.radians([5.0, 5.0, 5.0]), 0.1])
"""Standard deviations of boresight and delay before they are estimated."""
BLOCK_ROUNDS: Final = 14
LOOSE: Final = (30.0, 10.0, 3.0)
"""Factors of the pixels' standard deviation in the first rounds, in which the poses are off by many pixels."""
CONVERGED_PX: Final = 3e-3
"""The adjustment ends when residuals change by less, in pixels."""
DELAY_STEP_S: Final = 0.005
"""Time on both sides over which the motion of the camera is differentiated."""
MIN_PLACED_RATIO: Final = 1e-5
"""Square of the ratio of a point's accuracies across the view and along it, below which its distance is unknown."""
MAX_RESIDUAL_SIGMAS: Final = 5.0
"""Observations with larger residuals, in standard deviations, are left out."""


@dataclass(frozen=True)
class Known:
    """Known places (c, 3) of points in the map frame, their standard deviations, and their numbers in the ties."""

    point: IntArray
    xyz_m: FloatArray
    sigma_m: FloatArray
    name: tuple[str, ...]


NOTHING_KNOWN: Final = Known(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), ())


@dataclass(frozen=True)
class ImageBlock:
    """Images along a trajectory at the times stated for them, and what is known of its errors."""

    trajectory: Trajectory
    errors: PoseErrors
    camera: Camera
    t_s: FloatArray
    scale: float


@dataclass(frozen=True)
class AdjustedBlock:
    """Result of the adjustment.

    Attributes:
        camera: with the mounting and the delay that were found.
        correction_deg: (3,) of the mounting, about the vehicle's axes.
        sigma_deg: (3,) its standard deviations.
        delay_sigma_s: standard deviation of the delay.
        found: errors of the poses at the nodes, and their covariance with the images.
        covariance: (4 + 6 m,) squared, of boresight, delay, and the errors of the poses.
        used: (o,) which of them were used to the end.
        residual_px: (o, 2) of each.
        xyz_m: (p, 3) of the points.
        sigma_px: standard deviation of an observation, as its residuals show it.
        tension: what was found over what was expected of it before, of what the images tell; 1 where all sigmas hold.
    """

    camera: Camera
    correction_deg: tuple[float, float, float]
    sigma_deg: tuple[float, float, float]
    delay_sigma_s: float
    found: PoseErrors
    covariance: FloatArray
    ties: Ties
    used: NDArray[np.bool_]
    residual_px: FloatArray
    xyz_m: FloatArray
    sigma_px: float
    tension: float


@dataclass(frozen=True)
class _BlockState:
    """The unknowns."""

    fixed: FloatArray  # (4,) boresight and delay
    error: FloatArray  # (6 m,) errors of the poses at the nodes
    xyz_m: FloatArray  # (p, 3) points
    z: FloatArray  # (4 + 6 m,) all but the points in units of the root of their covariance before


def adjust_block(block: ImageBlock, ties: Ties, known: Known = NOTHING_KNOWN) -> AdjustedBlock:
    """Poses, boresight, delay and points at which the points appear where they were seen.

    The points of `known` are kept whatever their residuals are. Raises LinAlgError if the equations are singular.
    """
    root = root_of(CAMERA_SIGMAS, block.errors.covariance)
    unknowns = np.zeros(len(root))
    start = _BlockState(unknowns[:CAMERA_UNKNOWNS], unknowns[CAMERA_UNKNOWNS:], np.zeros((ties.points, 3)), unknowns)
    places = triangulate(_poses(block, start), block.camera, ties)
    places[known.point] = known.xyz_m
    state = replace(start, xyz_m=places)
    factor = 1.0
    before = np.zeros(len(ties))
    held = np.isin(ties.point, known.point)
    rows = _rows(block, state, ties)
    for number in range(BLOCK_ROUNDS):
        loose = LOOSE[number] if number < len(LOOSE) else 1.0
        sigma_px = ties.sigma_px * np.where(held, 1.0, factor)
        length = np.hypot(*rows.residual.T) / sigma_px
        robust = huber_weight(length / loose)
        trusted = rows.usable * ((length < MAX_RESIDUAL_SIGMAS) | held | (number <= len(LOOSE) + 1))
        weight = trusted * robust / sigma_px**2
        state, factorised = _step(state, ties, rows, weight, root, known)
        rows = _rows(block, state, ties)
        if number >= len(LOOSE):
            factor = _noise(rows, ties, known)
        moved = np.abs(np.hypot(*rows.residual.T) - before)
        before = np.hypot(*rows.residual.T)
        if number > len(LOOSE) + 2 and float(np.quantile(moved, 0.9)) < CONVERGED_PX:
            break
    covariance, left = covariance_after(factorised, root)
    determined = float((1.0 - left).sum())
    tension = float(np.sqrt((state.z**2).sum() / max(determined, 1.0)))
    return _result(block, state, covariance, ties, rows, weight, (float(np.median(sigma_px)), tension))


@dataclass(frozen=True)
class _Rows:
    """Linearised observations."""

    residual: FloatArray  # (o, 2) seen minus computed, pixels
    first: IntArray  # (o,) first column of the two nodes beside the exposure
    design: FloatArray  # (o, 2, 4 + 12) derivatives of the computed pixel by boresight, delay, and errors at both nodes
    by_point: FloatArray  # (o, 2, 3) by the place of the point
    usable: FloatArray  # (o,) 1 where the point is in front of the camera, else 0


@dataclass(frozen=True)
class _Exposures:
    """Poses of the vehicle when the images were taken, without the errors found so far."""

    xyz_m: FloatArray  # (n, 3) of its origin
    rotation: FloatArray  # (n, 3, 3) vehicle to map
    velocity_mps: FloatArray  # (n, 3) in the map frame
    rate_radps: FloatArray  # (n, 3) angular rate in the map's axes
    node: IntArray  # (n,) node before
    share: FloatArray  # (n,) of the way to the next one


def _exposures(block: ImageBlock, state: _BlockState) -> _Exposures:
    t_s = block.t_s + block.camera.shutter_delay_s + state.fixed[DELAY]
    track = block.trajectory
    nodes = block.errors.t_s
    # Poses end with the trajectory; a delay that is tried must not lead out of it.
    t_s = np.clip(t_s, track.span_s[0] + 2 * DELAY_STEP_S, track.span_s[1] - 2 * DELAY_STEP_S)
    at, early, late = (track.at(t_s + step) for step in (0.0, -DELAY_STEP_S, DELAY_STEP_S))
    turns = [Rotation.from_quat(one.quaternion, scalar_first=True) for one in (at, early, late)]
    node = np.clip(np.searchsorted(nodes, t_s, side="right") - 1, 0, len(nodes) - 2)
    share = np.clip((t_s - nodes[node]) / (nodes[node + 1] - nodes[node]), 0.0, 1.0)
    error = state.error.reshape(-1, POSE)
    off = (1.0 - share)[:, None] * error[node] + share[:, None] * error[node + 1]
    return _Exposures(
        at.xyz_m - off[:, :ROTATION],
        (Rotation.from_rotvec(-off[:, ROTATION:]) * turns[0]).as_matrix(),
        (late.xyz_m - early.xyz_m) / (2 * DELAY_STEP_S),
        (turns[2] * turns[1].inv()).as_rotvec() / (2 * DELAY_STEP_S),
        node.astype(np.int64),
        share,
    )


def _rows(block: ImageBlock, state: _BlockState, ties: Ties) -> _Rows:
    """Residuals and derivatives of all observations at a state."""
    e = _exposures(block, state)
    f = ties.frame
    stretch = np.array([block.scale, block.scale, 1.0])
    turned = e.rotation[f]
    mount = Rotation.from_rotvec(state.fixed[:DELAY]).as_matrix() @ block.camera.mounting.rotation
    offset = (state.xyz_m[ties.point] - e.xyz_m[f]) / stretch
    body = np.einsum("oij,oi->oj", turned, offset) - np.asarray(block.camera.xyz_m)
    seen = body @ mount
    computed = project(block.camera, seen)
    usable = np.isfinite(computed[:, 0])
    computed[~usable] = ties.pixel[~usable]
    seen = np.where(usable[:, None], seen, [0.0, 0.0, 1.0])
    by_view = _by_view(block.camera, seen)
    by_body = by_view @ mount.T
    by_offset = np.einsum("oab,ocb->oac", by_body, turned)
    by_point = by_offset / stretch
    by_turn = -by_offset @ cross_matrix(offset)
    by_time = -np.einsum("oab,ob->oa", by_point, e.velocity_mps[f]) - np.einsum("oab,ob->oa", by_turn, e.rate_radps[f])
    by_error = np.concatenate([by_point, by_turn], axis=2)
    share = e.share[f][:, None, None]
    design = np.concatenate(
        [by_body @ cross_matrix(body), by_time[:, :, None], (1.0 - share) * by_error, share * by_error], axis=2
    )
    first = CAMERA_UNKNOWNS + POSE * e.node[f]
    return _Rows(ties.pixel - computed, first, design, by_point, usable.astype(np.float64))


def _by_view(camera: Camera, seen: FloatArray) -> FloatArray:
    """(o, 2, 3) derivatives of pixels by points (o, 3) in the optical frame."""
    x = seen[:, 0] / seen[:, 2]
    y = seen[:, 1] / seen[:, 2]
    z = seen[:, 2]
    square = x * x + y * y
    radial = 1.0 + square * (camera.k1 + square * (camera.k2 + square * camera.k3))
    slope = camera.k1 + square * (2.0 * camera.k2 + 3.0 * square * camera.k3)
    xx = radial + 2.0 * x * x * slope + 2.0 * camera.p1 * y + 6.0 * camera.p2 * x
    xy = 2.0 * x * y * slope + 2.0 * camera.p1 * x + 2.0 * camera.p2 * y
    yy = radial + 2.0 * y * y * slope + 6.0 * camera.p1 * y + 2.0 * camera.p2 * x
    bent = np.stack([np.stack([xx, xy], 1), np.stack([xy, yy], 1)], 1) * np.array([[camera.fx], [camera.fy]])
    o = np.zeros_like(z)
    flat = np.stack([np.stack([1.0 / z, o, -x / z], 1), np.stack([o, 1.0 / z, -y / z], 1)], 1)
    out: FloatArray = bent @ flat
    return out


def triangulate(poses: FramePoses, camera: Camera, ties: Ties) -> FloatArray:
    """(p, 3) where the rays of each point meet best; `poses` are of the optical frame for all images."""
    stretch = np.array([poses.scale, poses.scale, 1.0])
    view = unproject(camera, ties.pixel)
    view = np.where(np.isfinite(view), view, [0.0, 0.0, 1.0])
    ray = np.einsum("oij,oj->oi", poses.rotation[ties.frame], view / np.linalg.norm(view, axis=1)[:, None])
    centre = poses.xyz_m[ties.frame] / stretch
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    begin = np.flatnonzero(np.diff(ties.point, prepend=-1))
    middle = np.add.reduceat(centre, begin) / np.diff(np.append(begin, len(ties)))[:, None]
    right = np.einsum("oij,oj->oi", across, centre - middle[ties.point])
    normal = np.add.reduceat(across, begin) + 1e-6 * np.eye(3)
    out: FloatArray = stretch * (middle + np.linalg.solve(normal, np.add.reduceat(right, begin)[:, :, None])[:, :, 0])
    return out


def meeting_angles(poses: FramePoses, camera: Camera, ties: Ties) -> FloatArray:
    """(p,) largest angle between the ray of a point's first observation and its others, radians."""
    view = unproject(camera, ties.pixel)
    ray = np.einsum("oij,oj->oi", poses.rotation[ties.frame], np.nan_to_num(view))
    ray /= np.maximum(np.linalg.norm(ray, axis=1), 1e-9)[:, None]
    begin = np.flatnonzero(np.diff(ties.point, prepend=-1))
    angle = np.arccos(np.clip(np.einsum("oi,oi->o", ray, ray[begin][ties.point]), -1.0, 1.0))
    out: FloatArray = np.maximum.reduceat(angle, begin)
    return out


def adjusted_poses(block: ImageBlock, adjusted: AdjustedBlock) -> FramePoses:
    """Poses of the optical frame by the adjustment."""
    return _poses(block, _state_of(block, adjusted))


def place_by_images(block: ImageBlock, adjusted: AdjustedBlock, ties: Ties) -> tuple[FloatArray, FloatArray]:
    """Where the adjusted poses see points (p, 3) that took no part, and the covariance (3 p, 3 p) of these places.

    Where residuals are larger than `ties` states, the views are as uncertain as these.
    """
    start = triangulate(adjusted_poses(block, adjusted), adjusted.camera, ties)
    rows = _rows(block, replace(_state_of(block, adjusted), xyz_m=start), ties)
    begin = np.flatnonzero(np.diff(ties.point, prepend=-1))
    weight = rows.usable / ties.sigma_px**2
    normal = np.add.reduceat(np.einsum("o,oak,oam->okm", weight, rows.by_point, rows.by_point), begin)
    # A point whose rays are parallel is uncertain by a kilometre.
    inverse = np.linalg.inv(normal + 1e-6 * np.eye(3))
    pull = np.add.reduceat(np.einsum("o,oak,oa->ok", weight, rows.by_point, rows.residual), begin)
    places = start + np.einsum("pkm,pm->pk", inverse, pull)
    residual = rows.residual - np.einsum("oak,ok->oa", rows.by_point, (places - start)[ties.point])
    freedom = max(2 * len(ties) - 3 * ties.points, 1)
    factor = max(1.0, float((weight[:, None] * residual**2).sum()) / freedom)
    by_unknowns = np.zeros((ties.points, 3, len(adjusted.covariance)))
    width = rows.design.shape[2]
    for o, point in enumerate(ties.point.tolist()):
        columns = np.append(np.arange(CAMERA_UNKNOWNS), rows.first[o] + np.arange(width - CAMERA_UNKNOWNS))
        by_unknowns[point][:, columns] -= weight[o] * inverse[point] @ rows.by_point[o].T @ rows.design[o]
    jacobian = by_unknowns.reshape(3 * ties.points, -1)
    return places, jacobian @ adjusted.covariance @ jacobian.T + scipy.linalg.block_diag(*(factor * inverse))


def _state_of(block: ImageBlock, adjusted: AdjustedBlock) -> _BlockState:
    """The unknowns of an adjustment, without points."""
    correction = adjusted.camera.mounting.rotation @ block.camera.mounting.rotation.T
    delay_s = adjusted.camera.shutter_delay_s - block.camera.shutter_delay_s
    fixed = np.append(Rotation.from_matrix(correction).as_rotvec(), delay_s)
    return _BlockState(fixed, adjusted.found.value.ravel(), np.zeros((0, 3)), np.zeros(0))


def _poses(block: ImageBlock, state: _BlockState) -> FramePoses:
    """Poses of the optical frame at a state."""
    e = _exposures(block, state)
    lever = np.array([block.scale, block.scale, 1.0]) * (e.rotation @ np.asarray(block.camera.xyz_m))
    mount = Rotation.from_rotvec(state.fixed[:DELAY]).as_matrix() @ block.camera.mounting.rotation
    exposed_s = block.t_s + block.camera.shutter_delay_s + state.fixed[DELAY]
    return FramePoses(exposed_s, e.xyz_m + lever, e.rotation @ mount, block.scale)


def _step(
    state: _BlockState, ties: Ties, rows: _Rows, weight: FloatArray, root: FloatArray, known: Known
) -> tuple[_BlockState, FloatArray]:
    """The state after a round, and the Cholesky factor of its equations."""
    ends = np.append(np.flatnonzero(np.diff(ties.point, prepend=-1)), len(ties))
    held = np.zeros((ties.points, 3))
    pull = np.zeros((ties.points, 3))
    held[known.point] = 1.0 / known.sigma_m**2
    pull[known.point] = (known.xyz_m - state.xyz_m[known.point]) / known.sigma_m**2
    # Points that their observations do not place would spoil the equations by rounding.
    own = np.einsum("o,oak,oam->okm", weight, rows.by_point, rows.by_point)
    values = np.linalg.eigvalsh(np.add.reduceat(own, ends[:-1]) + held[:, :, None] * np.eye(3))
    weight = weight * (values[:, 0] > MIN_PLACED_RATIO * values[:, 2])[ties.point]
    observed = ends, rows.residual, weight, rows.design, rows.first, rows.by_point
    normal, right, inverse = _reduce(*observed, held, pull, len(root))
    normal += np.tril(normal, -1).T
    step, factorised = solved(normal, right, root, state.z)
    moved = _move_points(*observed, inverse, pull, root @ step)
    z = state.z + step
    unknowns = root @ z
    return _BlockState(unknowns[:CAMERA_UNKNOWNS], unknowns[CAMERA_UNKNOWNS:], state.xyz_m + moved, z), factorised


@kernel()
def _reduce(ends, residual, weight, design, first, by_point, held, pull, unknowns):  # type: ignore[no-untyped-def]
    """Lower triangle of the normal matrix and the right side without the points; the inverses (p, 3, 3) of theirs."""
    normal = np.zeros((unknowns, unknowns))
    right = np.zeros(unknowns)
    inverse = np.zeros((len(ends) - 1, 3, 3))
    width = design.shape[2]
    beside = np.zeros((unknowns, 3))
    share = np.empty(3)
    seen = np.zeros(unknowns, np.bool_)
    active = np.empty(unknowns, np.int64)
    column = np.empty(width, np.int64)
    for p in range(len(ends) - 1):
        own = inverse[p]
        own_right = pull[p].copy()
        count = 0
        for o in range(ends[p], ends[p + 1]):
            if weight[o] == 0.0:
                continue
            for j in range(width):
                column[j] = j if j < 4 else first[o] + j - 4
            for j in range(width):
                u = column[j]
                if not seen[u]:
                    seen[u] = True
                    active[count] = u
                    beside[u] = 0.0
                    count += 1
                for a in range(2):
                    by = weight[o] * design[o, a, j]
                    right[u] += by * residual[o, a]
                    for k in range(3):
                        beside[u, k] += by * by_point[o, a, k]
                    for k in range(j + 1):
                        normal[u, column[k]] += by * design[o, a, k]
            for a in range(2):
                for k in range(3):
                    by = weight[o] * by_point[o, a, k]
                    own_right[k] += by * residual[o, a]
                    for m in range(3):
                        own[k, m] += by * by_point[o, a, m]
        if count == 0:
            continue
        for k in range(3):
            own[k, k] += held[p, k]
        _invert(own)
        for i in range(count):
            u = active[i]
            for k in range(3):
                share[k] = beside[u, 0] * own[0, k] + beside[u, 1] * own[1, k] + beside[u, 2] * own[2, k]
                right[u] -= share[k] * own_right[k]
            for k in range(count):
                v = active[k]
                if v <= u:
                    normal[u, v] -= share[0] * beside[v, 0] + share[1] * beside[v, 1] + share[2] * beside[v, 2]
        for i in range(count):
            seen[active[i]] = False
    return normal, right, inverse


@kernel()
def _invert(m):  # type: ignore[no-untyped-def]
    """Invert a positive definite matrix (3, 3) in its place; numba's own inverse compiles for two seconds."""
    for k in range(3):
        pivot = m[k, k]
        m[k, k] = 1.0
        for j in range(3):
            m[k, j] /= pivot
        for i in range(3):
            if i != k:
                factor = m[i, k]
                m[i, k] = 0.0
                for j in range(3):
                    m[i, j] -= factor * m[k, j]


@kernel()
def _move_points(ends, residual, weight, design, first, by_point, inverse, pull, step):  # type: ignore[no-untyped-def]
    """(p, 3) steps of the points, those of the other unknowns known."""
    out = np.zeros((len(ends) - 1, 3))
    width = design.shape[2]
    for p in range(len(ends) - 1):
        right = pull[p].copy()
        for o in range(ends[p], ends[p + 1]):
            for a in range(2):
                left = residual[o, a]
                for j in range(width):
                    left -= design[o, a, j] * step[j if j < 4 else first[o] + j - 4]
                for k in range(3):
                    right[k] += weight[o] * by_point[o, a, k] * left
        for k in range(3):
            for m in range(3):
                out[p, k] += inverse[p, k, m] * right[m]
    return out


def _noise(rows: _Rows, ties: Ties, known: Known) -> float:
    """Factor of the standard deviations by which the residuals of ties are as large as expected."""
    of_tie = ~np.isin(ties.point, known.point) & (rows.usable > 0)
    if not of_tie.any():
        return 1.0
    seen = np.bincount(ties.point, minlength=ties.points)[ties.point]
    # NMAD of residuals; a point takes three of their degrees of freedom, the poses few of all.
    share = np.sqrt(2.0 * seen / (2.0 * seen - 3.0))
    length = np.abs(rows.residual[of_tie]) * (share / ties.sigma_px)[of_tie, None]
    return max(float(1.4826 * np.median(length)), 1e-3)


def _result(
    block: ImageBlock,
    state: _BlockState,
    covariance: FloatArray,
    ties: Ties,
    rows: _Rows,
    weight: FloatArray,
    figures: tuple[float, float],
) -> AdjustedBlock:
    stated = block.camera
    rotation = Rotation.from_rotvec(state.fixed[:DELAY]).as_matrix() @ stated.mounting.rotation
    mounting = Mounting.from_rotation(stated.xyz_m, rotation)
    camera = replace(
        stated, rpy_deg=mounting.rpy_deg, shutter_delay_s=stated.shutter_delay_s + float(state.fixed[DELAY])
    )
    sigma = np.sqrt(np.diag(covariance)[:CAMERA_UNKNOWNS])
    x, y, z = np.degrees(state.fixed[:DELAY]).tolist()
    sx, sy, sz = np.degrees(sigma[:DELAY]).tolist()
    found = PoseErrors(block.errors.t_s, state.error.reshape(-1, POSE), covariance[CAMERA_UNKNOWNS:, CAMERA_UNKNOWNS:])
    return AdjustedBlock(
        camera,
        (x, y, z),
        (sx, sy, sz),
        float(sigma[DELAY]),
        found,
        covariance,
        ties,
        weight > 0.0,
        rows.residual,
        state.xyz_m,
        *figures,
    )
