"""One cause, one finding: which warnings follow from another, and which to act on first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from furrowmap.core.runtime.errors import CONTRADICTION, Notice

DAMAGED: Final = (
    "cut-stream", "stream-cut", "cut-capture", "damaged-records", "bag-cut", "bag-chunk-damaged", "bag-file-missing",
    "osf-damaged", "time-log-damaged", "points-without-pose.log-shorter",
)  # fmt: skip
"""Codes or keys of inputs that end early, or of which whole parts are lost."""
AT_TOP: Final = (
    *DAMAGED,
    "mounting-identity",
    "antenna-unknown",
    "mounting-off",
    "clock-offset",
    "scanner-clock-off",
    "imu-clock-off",
    "imu-frozen",
    "imu-scale-off",
    "gnss-frozen",
    "gnss-steps",
    "gnss-heights",
    "lever-arm-off",
    "mounting-height",
    "tool-apart",
    "boundary-apart",
    "control-points-off",
    "ground-control-shift",
    "ground-control-left-out",
    "facing-assumed",
    "lever-assumed",
    "slow-errors-assumed",
)
"""Of lost input, and of what was corrected or is assumed and moves a whole cloud or map: first in reports.

What is missing comes first, then what is wrong in a log or the session, last what nothing confirms.
"""
CONTRADICTING_CODES: Final = (
    CONTRADICTION,
    "imu-turned",
    "geoid-separation",
    "gnss-height-steps",
    "control-points-contradict",
    "ground-control-contradicts",
    "parcels-beside-crop",
    "treatments-order",
    "images-contradict",
    "check-points-off",
)
"""Codes of contradictions, in the order in which they are acted on."""
_IMPLEMENT_UNKNOWN: Final = (
    "implement-never-moves",
    "implement-no-ground",
    "implement-not-seen",
    "implement-unclear",
    "machine-not-known",
    "tool-apart",
)
_UNPLACED: Final = (
    CONTRADICTION,
    "mounting-off",
    "mounting-height",
    "lever-arm-off",
    "lever-assumed",
    "facing-assumed",
    "boresight-off",
    "boresight-assumed",
    "level-assumed",
    "slow-errors-assumed",
    "clock-offset",
    "gnss-outliers",
    "matching-unsolved",
    "check-points-off",
    *_IMPLEMENT_UNKNOWN,
)
_IMU_MISREAD: Final = (
    "contradiction.force-scatters",
    "imu-turned",
    "imu-noisier",
    "imu-shaken",
    "imu-misses-motion",
    "imu-not-aligned",
    "lever-arm-off",
)
_POSITIONS_ERR: Final = (
    "contradiction.positions-err",
    "contradiction.scatter",
    "contradiction.creep",
    "contradiction.height-creep",
    "check-points-off",
    "gnss-outliers",
)
FOLLOWS: Final[Mapping[str, tuple[str, ...]]] = {
    "mounting-identity": ("antenna-unknown", *_UNPLACED),
    "antenna-unknown": _UNPLACED,
    "imu-gravity": _IMU_MISREAD,
    "imu-rate-unit": _IMU_MISREAD,
    "imu-axes": _IMU_MISREAD,
    "imu-turned": (
        "contradiction.turned-scanner",
        "contradiction.lever-arm",
        "contradiction.force-scatters",
        "boresight-off",
    ),
    "imu-frozen": ("imu-pauses", "imu-not-aligned"),
    "imu-shaken": ("imu-noisier",),
    "geoid-separation": ("check-points-off", "epoch-and-geoid", "mounting-height"),
    "gnss-height-steps": ("gnss-heights", *_POSITIONS_ERR),
    "gnss-frozen": _POSITIONS_ERR,
    "gnss-steps": (*_POSITIONS_ERR, "mounting-off.level-ground"),
    "gnss-heights": ("contradiction.height-creep", "check-points-off", "mounting-height"),
    "contradiction.scans-and-positions": (
        "mounting-off.level-ground",
        "level-assumed",
        "mounting-height",
        "lever-assumed",
        "facing-assumed",
        "slow-errors-assumed",
        "gnss-outliers",
        *_IMPLEMENT_UNKNOWN,
    ),
    "contradiction.turned-scanner": ("boresight-off", "camera-mounting-off"),
    "contradiction.scattered-ground": ("boresight-assumed",),
    "contradiction.elevations-of-another": ("boresight-off", "boresight-assumed"),
    "contradiction.positions-late": ("imu-clock-off", "scanner-clock-off", "camera-times-off"),
    "contradiction.lever-arm": ("lever-arm-off",),
    "contradiction.height-creep": ("check-points-off",),
    "ground-control-contradicts": ("check-points-off",),
    "mounting-height": ("implement-no-ground", "machine-not-known"),
    "implement-no-ground": ("machine-not-known",),
    "parcels-beside-crop": ("parcels-unmeasured", "soil-not-aligned"),
    "treatments-missing": ("treatments-order",),
    "matching-unsolved": ("level-assumed",),
    "gnss-quality": ("slow-errors-assumed",),
    "gnss-outage": ("gaps", "gap-not-bridged", "scans-not-held", "points-without-pose", "imu-not-aligned"),
    "gaps": ("gap-not-bridged", "points-without-pose"),
    "scans-not-held": ("points-without-pose",),
    "camera-uncalibrated": ("images-unused", "nothing-coloured"),
    "images-contradict": ("images-not-adjusted", "nothing-coloured"),
    "images-missing": ("images-without-pose", "nothing-coloured"),
    "images-without-pose": ("nothing-coloured",),
    "lost-packets": ("pauses",),
    "cut-stream": ("cut-capture",),
    "bag-cut": ("bag-orphans", "bag-count"),
}
"""By the code or key of a cause: the codes or keys of the warnings that follow from it where both stand."""
_UNTIL_ENTERED: Final = ("mounting-identity", "antenna-unknown")
"""Codes of what the session leaves out: nothing can agree before that is entered."""
_ORDER: Final = dict.fromkeys((*_UNTIL_ENTERED, *CONTRADICTING_CODES, *AT_TOP, *FOLLOWS))
_RANKS: Final = {code: rank for rank, code in enumerate(_ORDER)}


@dataclass(frozen=True)
class Finding:
    """A warning that follows from no other, and those that follow from it."""

    notice: Notice
    follows: tuple[Notice, ...] = ()

    @property
    def all(self) -> tuple[Notice, ...]:
        """The warning and what follows from it."""
        return self.notice, *self.follows


def is_one_of(notice: Notice, names: Sequence[str]) -> bool:
    """Whether the code or the key of a warning is among some."""
    return notice.code in names or notice.key in names


def findings(notices: Sequence[Notice]) -> list[Finding]:
    """Warnings by their causes: what to do first comes first, others in their order."""
    causes = [cause_of(notice, notices) for notice in notices]
    found = [
        Finding(notice, tuple(other for other, cause in zip(notices, causes, strict=True) if cause is notice))
        for notice, cause in zip(notices, causes, strict=True)
        if cause is None
    ]
    return sorted(found, key=lambda finding: min(map(_rank, finding.all)))


def by_cause(notices: Sequence[Notice]) -> tuple[Notice, ...]:
    """Warnings sorted by what to do first, each directly behind its cause."""
    return tuple(notice for finding in findings(notices) for notice in finding.all)


def cause_of(notice: Notice, notices: Sequence[Notice]) -> Notice | None:
    """The warning among `notices` that a warning follows from in the end; None for one that is its own cause."""
    cause = None
    above = _direct(notice, notices)
    while above is not None:  # ends: FOLLOWS has no circle, which a test checks
        cause = above
        above = _direct(above, notices)
    return cause


def _direct(notice: Notice, notices: Sequence[Notice]) -> Notice | None:
    """The warning that a warning follows from; the one to act on first of several."""
    own = {notice.code, notice.key}
    causes = [
        other
        for other in notices
        if not own.isdisjoint((*FOLLOWS.get(other.key, ()), *FOLLOWS.get(other.code, ())))
        and (not notice.subject or other.subject in ("", notice.subject))
    ]
    return min(causes, key=_rank, default=None)


def _rank(notice: Notice) -> int:
    return min(_RANKS.get(name, len(_RANKS)) for name in (notice.code, notice.key))
