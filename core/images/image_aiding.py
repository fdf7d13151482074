"""A trajectory aided by the images of a camera: features, ties, control points, adjustment, and whether to trust it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.images.block_adjustment import (
    CAMERA_SIGMAS,
    NOTHING_KNOWN,
    AdjustedBlock,
    ImageBlock,
    Known,
    adjust_block,
    adjusted_poses,
    meeting_angles,
    triangulate,
)
from furrowmap.core.images.control_agreement import ControlAgreement, held_against_poses
from furrowmap.core.images.control_points import ControlPoints, control_views, join_views
from furrowmap.core.images.image_features import ImageFeatures, find_features, match_features
from furrowmap.core.images.image_frames import frame_poses
from furrowmap.core.images.pinhole import inside, project, unproject
from furrowmap.core.images.ties import Ties, overlapping, seen_in, thin_ties, tracks
from furrowmap.core.readers.image_pixels import image_size
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.trajectory.located import Located
from furrowmap.core.trajectory.pose_errors import PoseErrors, without_errors
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.images import CONTRADICTING, ImageFile, Images
from furrowmap.core.values.trajectory import Trajectory

MIN_IMAGES: Final = 3
MIN_CONTROL_POINTS: Final = 3
"""Control points that place a block without the positions."""
MIN_TIE_POINTS: Final = 100
MIN_MEETING_ANGLE_RAD: Final = np.radians(2.0)
"""Rays that meet at a smaller angle do not show where a point is."""
MATCHING_MARGIN: Final = 0.15
"""Margin around an image, in its lengths, within which features of another one are compared with its own."""
END_MARGIN_S: Final = 0.5
"""Images nearer to an end of the trajectory are left out: the delay of the shutter may lead out of it."""
MIN_USED_SHARE: Final = 0.5
"""Share of the observations that must fit the poses together."""
MAX_RESIDUAL_PX: Final = 2.0
"""Matches with larger residuals are not of this camera or this trajectory."""
WARN_RESIDUAL_PX: Final = 1.0
"""Residuals of good intrinsics are below half a pixel; beyond this there is a warning."""
WARN_TENSION: Final = 2.0
"""Of a flight whose camera is as stated it is 0.8 to 1.3."""
WARN_SIGMAS: Final = 2.0
"""Mounting and delay that differ from the stated ones by more of their standard deviations give a warning."""
MAX_NAMED_POINTS: Final = 5
"""Control points that a notice names."""
MAX_TENSION: Final = 3.0
"""Errors found in the poses, in standard deviations of what GNSS and IMU leave open, beyond which they contradict."""


@dataclass(frozen=True)
class LeftOutPoint:
    """A control point that takes no part: seen in so many images, `off_m` (3,) from where it was surveyed."""

    name: str
    images: int
    off_m: tuple[float, ...]


@dataclass(frozen=True)
class ControlledBlock:
    """A block with control points.

    Attributes:
        known: the points that place it.
        left_out: those that contradict them or the poses.
        control_shift_m: (3,) by which all points contradict the poses alike; None where they do not.
        notices: which points are not seen or do not agree.
    """

    adjusted: AdjustedBlock
    known: Known = NOTHING_KNOWN
    left_out: tuple[LeftOutPoint, ...] = ()
    control_shift_m: tuple[float, ...] | None = None
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class ImageAid:
    """What images made of a trajectory.

    Attributes:
        control: the adjusted block: camera, errors of the poses, residuals, and control points.
        before: errors of the poses as GNSS and IMU know them.
        shift_m: (3,) mean of the exposures' places after the adjustment minus before.
        shift_sigma_m: (3,) standard deviations of the place of the block as a whole.
    """

    trajectory: Trajectory
    images: int
    control: ControlledBlock
    before: PoseErrors
    shift_m: tuple[float, ...]
    shift_sigma_m: tuple[float, ...]

    @property
    def adjusted(self) -> AdjustedBlock:
        """The block with the control points that agree."""
        return self.control.adjusted

    @property
    def camera(self) -> Camera:
        """The camera with the mounting and the shutter delay that were found."""
        return self.adjusted.camera

    @property
    def _ties(self) -> NDArray[np.bool_]:
        """(o,) the observations that are not of control points."""
        out: NDArray[np.bool_] = ~np.isin(self.adjusted.ties.point, self.control.known.point)
        return out

    @property
    def reprojection_px(self) -> float:
        """RMS of the residuals of ties that were used, column and row together."""
        chosen = self._ties & self.adjusted.used
        return float(np.sqrt((self.adjusted.residual_px[chosen] ** 2).sum(axis=1).mean()))

    def control_residuals(self) -> list[dict[str, Any]]:
        """Adjusted minus surveyed place, and residuals, of each control point; those that take no part have none."""
        adjusted = self.adjusted
        known = self.control.known
        out: list[dict[str, Any]] = []
        for name, point, xyz_m in zip(known.name, known.point.tolist(), known.xyz_m, strict=True):
            own = adjusted.ties.point == point
            rms = float(np.sqrt((adjusted.residual_px[own] ** 2).sum(axis=1).mean()))
            off = np.round(adjusted.xyz_m[point] - xyz_m, 4).tolist()
            images = int(own.sum())
            out.append({"name": name, "images": images, "residual_px": round(rms, 3), "off_m": off, "used": True})
        for one in self.control.left_out:
            off = np.round(one.off_m, 4).tolist()
            out.append({"name": one.name, "images": one.images, "residual_px": None, "off_m": off, "used": False})
        return out

    def sigmas(self) -> tuple[FloatArray, FloatArray]:
        """Medians over the nodes, before and after: easting, northing, height (m), roll, pitch, heading (rad)."""
        t_s = np.clip(self.before.t_s, *self.trajectory.span_s)
        nodes = self.trajectory.at(t_s).quaternion
        seen = np.isfinite(nodes[:, 0])
        rotation = np.zeros((len(nodes), 3, 3))
        rotation[seen] = Rotation.from_quat(nodes[seen], scalar_first=True).as_matrix()
        before, after = (np.median(e.sigma(rotation)[seen], axis=0) for e in (self.before, self.adjusted.found))
        return before, after

    def plain(self) -> dict[str, Any]:
        """For `report.json`."""
        a = self.adjusted
        before, after = self.sigmas()
        return {
            "images": self.images,
            "points": int(np.unique(a.ties.point[self._ties]).size),
            "observations": int(self._ties.sum()),
            "observations_used": int((self._ties & a.used).sum()),
            "reprojection_rms_px": round(self.reprojection_px, 3),
            "observation_sigma_px": round(a.sigma_px, 3),
            "shift_m": np.round(self.shift_m, 4).tolist(),
            "shift_sigma_m": np.round(self.shift_sigma_m, 4).tolist(),
            "sigma_before_m": np.round(before[:3], 5).tolist(),
            "sigma_after_m": np.round(after[:3], 5).tolist(),
            "sigma_before_deg": np.round(np.degrees(before[3:]), 5).tolist(),
            "sigma_after_deg": np.round(np.degrees(after[3:]), 5).tolist(),
            "tension": round(a.tension, 3),
            "control_points": self.control_residuals(),
        }

    def calibration(self) -> dict[str, Any]:
        """The camera's mounting and shutter delay, for `report.json`."""
        a = self.adjusted
        return {
            "rpy_deg": np.round(a.camera.rpy_deg, 5).tolist(),
            "sigma_deg": np.round(a.sigma_deg, 5).tolist(),
            "correction_deg": np.round(a.correction_deg, 5).tolist(),
            "shutter_delay_s": round(a.camera.shutter_delay_s, 6),
            "shutter_delay_sigma_s": round(a.delay_sigma_s, 6),
        }


@dataclass(frozen=True)
class AidedTrajectory:
    """A trajectory adjusted by images; as it was, without `aid` and with a notice why, where they do not serve."""

    located: Located
    aid: ImageAid | None
    notices: tuple[Notice, ...]


def aid_by_images(
    located: Located,
    images: Images,
    camera: Camera,
    scale: float,
    control: ControlPoints | None,
    progress: Progress,
    features: Mapping[ImageFile, ImageFeatures] | None = None,
) -> AidedTrajectory:
    """The trajectory adjusted by images.

    Args:
        images: with the times stated for them.
        scale: metres of the map for a metre on the ground.
        control: surveyed points; None without.
        features: of the images where they are known already; other images are left out.
    """
    if located.pose_errors is None:
        why = Text("only a trajectory by GNSS and an IMU says how the errors of its poses go together")
        return AidedTrajectory(located, None, (unused(why),))
    images, notices = _usable(images, features, camera, located.trajectory)
    if len(images) < MIN_IMAGES:
        why = Text("there are {images} that can be read and have a pose", images=len(images))
        return AidedTrajectory(located, None, (*notices, unused(why)))
    exposed_s = images.t_s + camera.shutter_delay_s
    block = ImageBlock(located.trajectory, located.pose_errors(exposed_s), camera, images.t_s, scale)
    try:
        if features is None:
            features = find_features(images.paths, progress)
        ties = _ties(block, [features[path] for path in images.paths], progress)
        if isinstance(ties, Notice):
            return AidedTrajectory(located, None, (*notices, ties))
        progress("adjusting images", 0.0)
        controlled = ControlledBlock(adjust_block(block, ties))
        if control is not None and doubtful(controlled.adjusted) is None:
            controlled = with_control(block, controlled.adjusted, control, images)
    except (np.linalg.LinAlgError, RuntimeError, ValueError) as error:
        why = Text("the adjustment failed ({why})", why=reason(error))
        return AidedTrajectory(located, None, (*notices, unused(why)))
    progress("adjusting images", 1.0)
    notices += controlled.notices
    adjusted = controlled.adjusted
    doubt = doubtful(adjusted)
    if doubt is not None:
        return AidedTrajectory(located, None, (*notices, contradicting(doubt)))
    notices += camera_notices(adjusted, camera)
    aid = _aid(block, controlled)
    after = PoseErrors(adjusted.found.t_s, np.zeros_like(adjusted.found.value), adjusted.found.covariance)
    kept = notices_beside(located.notices, controlled.known)
    used = replace(located, trajectory=aid.trajectory, notices=kept, pose_errors=lambda _: after)
    return AidedTrajectory(used, aid, tuple(notices))


def notices_beside(notices: tuple[Notice, ...], known: Known) -> tuple[Notice, ...]:
    """Notices about a trajectory; where control points place it, not that it is only as good as its positions."""
    if len(set(known.name)) < MIN_CONTROL_POINTS:
        return notices
    return tuple(notice for notice in notices if notice.code != "gnss-quality")


def unused(why: Words) -> Notice:
    """The notice of images that do not aid the trajectory."""
    return Notice("images-not-adjusted", why=why)


def contradicting(why: Words) -> Notice:
    """The notice of images that contradict what else is known, so that their colours would be wrong as well."""
    return Notice(CONTRADICTING, why=why)


def camera_notices(adjusted: AdjustedBlock, stated: Camera) -> list[Notice]:
    """What of the table `[camera]` the images show to be wrong, though they can be used."""
    found = []
    late_s = adjusted.camera.shutter_delay_s - stated.shutter_delay_s
    if abs(late_s) > WARN_SIGMAS * CAMERA_SIGMAS[3]:
        found.append(Notice("camera-times-off", late_s=abs(late_s), is_late_s=late_s > 0.0))
    off_deg = float(np.linalg.norm(adjusted.correction_deg))
    if off_deg > np.degrees(WARN_SIGMAS * CAMERA_SIGMAS[0]):
        angles = ", ".join(f"{angle:.2f}" for angle in adjusted.camera.rpy_deg)
        found.append(Notice("camera-mounting-off", off_deg=off_deg, angles=angles))
    if adjusted.tension > WARN_TENSION:
        found.append(Notice("camera-tension", tension=adjusted.tension))
    if adjusted.sigma_px > WARN_RESIDUAL_PX:
        found.append(Notice("camera-residuals", sigma_px=adjusted.sigma_px))
    return found


def _usable(
    images: Images,
    features: Mapping[ImageFile, ImageFeatures] | None,
    camera: Camera,
    trajectory: Trajectory,
) -> tuple[Images, list[Notice]]:
    """The images that can be read, have the camera's size and were taken within the trajectory."""
    begin_s, end_s = trajectory.span_s
    exposed_s = images.t_s + camera.shutter_delay_s
    posed = np.isfinite(frame_poses(trajectory, camera, images.t_s).xyz_m[:, 0])
    posed &= (exposed_s > begin_s + END_MARGIN_S) & (exposed_s < end_s - END_MARGIN_S)
    if features is not None:
        posed &= np.array([path in features for path in images.paths], np.bool_)
    # Two of one time would be two poses at one place.
    posed &= np.diff(images.t_s, prepend=-np.inf) > 0.0
    fits = np.zeros(len(images), np.bool_)
    for k in np.flatnonzero(posed).tolist():
        fits[k] = image_size(images.paths[k]) == (camera.width, camera.height)
    notices = []
    if not fits[posed].all():
        first = images.paths[int(np.flatnonzero(posed & ~fits)[0])].name
        notices.append(
            Notice(
                "images-unreadable",
                posed=int((posed & ~fits).sum()),
                images=len(images),
                width=camera.width,
                height=camera.height,
                first=first,
            )
        )
    return images.chosen(np.flatnonzero(fits)), notices


def _ties(block: ImageBlock, features: Sequence[ImageFeatures], progress: Progress) -> Ties | Notice:
    """Ties of the images, spread evenly over them; why there are none."""
    poses = frame_poses(block.trajectory, block.camera, block.t_s, block.scale)
    size = block.camera.width, block.camera.height
    keypoints = {k: own.places for k, own in enumerate(features)}
    following = [(k, k + 1) for k in range(len(features) - 1)]
    matches = match_features(features, following, progress)
    first = _well_met(block, tracks(keypoints, matches))
    if first.points < MIN_TIE_POINTS:
        return unused(Text("images that follow each other have {points} points in common", points=first.points))
    depth = np.einsum(
        "oi,oi->o",
        poses.rotation[first.frame][:, :, 2],
        triangulate(poses, block.camera, first)[first.point] - poses.xyz_m[first.frame],
    )
    ahead = depth[depth > 0.0]
    if len(ahead) < MIN_TIE_POINTS:
        return contradicting(Text("the points that they have in common are behind the camera. Check [camera] rpy_deg"))
    depth_m = float(np.median(ahead))
    margin_px = MATCHING_MARGIN * max(size)
    points_m = [depth_m * unproject(block.camera, own.places[:, :2]) for own in features]

    def shared(own: int, other: int) -> NDArray[np.bool_]:
        return inside(block.camera, seen_in(poses, block.camera, own, other, points_m[own]), margin_px)

    near = overlapping(poses, block.camera, depth_m)
    matches |= match_features(features, sorted(set(near) - set(following)), progress, shared)
    ties = thin_ties(_well_met(block, tracks(keypoints, matches)), size)
    if ties.points < MIN_TIE_POINTS:
        return unused(Text("they have {points} points in common", points=ties.points))
    return ties


def _well_met(block: ImageBlock, ties: Ties) -> Ties:
    """The ties whose rays meet at an angle that shows where the point is."""
    if not len(ties):
        return ties
    poses = frame_poses(block.trajectory, block.camera, block.t_s, block.scale)
    return ties.chosen((meeting_angles(poses, block.camera, ties) > MIN_MEETING_ANGLE_RAD)[ties.point])


def with_control(block: ImageBlock, adjusted: AdjustedBlock, control: ControlPoints, images: Images) -> ControlledBlock:
    """The adjustment with the control points that agree; `adjusted`, which is without any, where there are none."""
    views = control_views(control, block, adjusted, images.paths)
    if views is None:
        return ControlledBlock(adjusted, notices=(Notice("control-points-unseen", control=len(control.name)),))
    seen, known = views
    agreement = held_against_poses(block, adjusted, seen, known)
    notices = (*_unseen(control, known, block, adjusted), *control_notices(known.name, agreement))
    kept = agreement.kept
    shift_m = None if agreement.shift_m is None else tuple(agreement.shift_m.tolist())
    number = np.bincount(seen.point)
    left_out = tuple(
        LeftOutPoint(known.name[k], int(number[k]), tuple((-agreement.off_m[k]).tolist()))
        for k in np.flatnonzero(~kept).tolist()
    )
    if not kept.any():
        return ControlledBlock(adjusted, NOTHING_KNOWN, left_out, shift_m, notices)
    names = tuple(known.name[k] for k in np.flatnonzero(kept).tolist())
    agreeing = Known(np.arange(len(names)), known.xyz_m[kept], known.sigma_m[kept], names)
    ties, joined = join_views(adjusted.ties, seen.chosen(kept[seen.point]), agreeing)
    return ControlledBlock(adjust_block(block, ties, joined), joined, left_out, shift_m, notices)


def _unseen(control: ControlPoints, known: Known, block: ImageBlock, adjusted: AdjustedBlock) -> list[Notice]:
    """The notice of points that images should show, and do not."""
    poses = adjusted_poses(block, adjusted)
    shown = np.zeros(len(control.name), np.int64)
    for k in range(len(poses)):
        pixel = project(adjusted.camera, poses.in_frame(k, control.xyz_m))
        shown += inside(adjusted.camera, np.nan_to_num(pixel, nan=-1e9))
    lacking = [name for name, images in zip(control.name, shown, strict=True) if images >= 2 and name not in known.name]
    return [Notice("control-points-unseen.no-plate", names=", ".join(lacking))] if lacking else []


def control_notices(names: Sequence[str], agreement: ControlAgreement) -> list[Notice]:
    """What is said of control points that contradict the poses or each other."""
    if agreement.kept.all():
        return []
    if agreement.shift_m is not None:
        east_m, north_m, up_m = agreement.shift_m.tolist()
        shift = {"east_m": east_m, "north_m": north_m, "up_m": up_m}
        return [Notice("control-points-contradict.all-shifted", alike=agreement.alike, control=len(names), **shift)]
    left_out = np.flatnonzero(~agreement.kept).tolist()
    points = "; ".join(
        f"{names[k]} [{', '.join(f'{off:+.3f}' for off in agreement.off_m[k].tolist())}]"
        for k in left_out[:MAX_NAMED_POINTS]
    )
    figures = {"points": points, "more": len(left_out) > MAX_NAMED_POINTS}
    if agreement.kept.any():
        return [Notice("control-points-off", left_out=len(left_out), control=len(names), **figures)]
    return [Notice("control-points-contradict", **figures)]


def doubtful(adjusted: AdjustedBlock) -> Text | None:
    """Why an adjustment is not to be used; None where it is."""
    share = float(adjusted.used.mean())
    if share < MIN_USED_SHARE or adjusted.sigma_px > MAX_RESIDUAL_PX:
        return Text(
            "their points do not fit its poses together ({share:.0%} of the observations, "
            "residuals of {sigma_px:.1f} pixels). Check times, intrinsics and mounting in "
            "`[camera]`",
            share=share,
            sigma_px=adjusted.sigma_px,
        )
    if adjusted.tension > MAX_TENSION:
        return Text(
            "they contradict GNSS and IMU (errors {tension:.1f} times as large as these "
            "leave open). Check times, intrinsics and mounting in `[camera]`, and the "
            "coordinates of control points",
            tension=adjusted.tension,
        )
    return None


def _aid(block: ImageBlock, controlled: ControlledBlock) -> ImageAid:
    adjusted = controlled.adjusted
    found = adjusted.found
    exposed_s = adjusted_poses(block, adjusted).t_s
    nodes = len(found.t_s)
    # The mean over all exposures of what is interpolated between the nodes.
    share = np.array([np.interp(exposed_s, found.t_s, unit).mean() for unit in np.eye(nodes)])
    spread = found.covariance.reshape(nodes, 6, nodes, 6)[:, :3, :, :3]
    variance = np.einsum("i,iajb,j->ab", share, spread, share)
    shift = -(share @ found.value[:, :3])
    return ImageAid(
        without_errors(block.trajectory, block.errors, found),
        len(block.t_s),
        controlled,
        block.errors,
        tuple(shift.tolist()),
        tuple(np.sqrt(np.diag(variance)).tolist()),
    )
