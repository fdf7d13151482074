"""What contradicts what: the likely cause, its words, and the standard deviations that follow."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.matching.antenna_sway import AntennaSway
from furrowmap.core.matching.clock_offset import AntennaConstants
from furrowmap.core.matching.consistency import (
    Cause,
    GroundTilt,
    Seen,
    clock_notice,
    contradiction_notice,
    enlarge_sigmas,
)
from furrowmap.core.matching.laser_elevations import GroundPlane, OtherModel
from furrowmap.core.matching.yaw_ambiguity import Facing
from furrowmap.core.values.trajectory import Trajectory

CLOCK = AntennaConstants(clock_s=0.4, clock_sigma_s=0.01, clock_gain=1e5, lever_gain=1e2)
LEVER = AntennaConstants(lever_m=(-0.6, 0.8), lever_sigma_m=(0.01, 0.01), lever_gain=1e5, clock_gain=1e2)
EITHER = AntennaConstants(clock_s=0.4, lever_m=(-0.6, 0.8), clock_gain=1e5, lever_gain=1e5)
SWAY = AntennaSway(lever_m=(0.0, 0.0, 0.5), sigma_m=(0.1, 0.1, 0.01))
SWAY_LATE = AntennaSway(lever_m=(0.0, 0.0, 0.5), sigma_m=(0.1, 0.1, 0.01), clock_s=-1.0)
SWAY_ALONE = AntennaSway(lever_m=(0.0, 0.0, 0.5), sigma_m=(0.1, 0.1, 0.01), unrelated=True)

HI_RES = OtherModel("Puck Hi-Res", "VLP-16", GroundPlane(11.0, -0.5, 0.9))
BACKWARDS = GroundTilt(facing=Facing(180.0, shown=True))


@pytest.mark.parametrize(
    ("seen", "cause", "words"),
    [
        (Seen(), None, ()),
        (Seen(slip=1.3, drift=2.9), None, ()),
        (Seen(slip=5.0), Cause.UNKNOWN, ("slips sideways 5.0 times", "may be wrong")),
        (Seen(drift=7.5), Cause.UNKNOWN, ("drift 7.5 times", "may be wrong")),
        (Seen(slow_times=12.2), Cause.POSITIONS, ("err slowly together, 12 times", "PPP, DGNSS")),
        (Seen(slow_times=12.2, constants=CLOCK), Cause.POSITIONS, ("err slowly",)),
        (Seen(slow_times=12.2, sway=SWAY), Cause.LEVER_ARM, ("lever arm of the antenna",)),
        (Seen(constants=CLOCK), Cause.CLOCK, ("+0.400 s apart", "lidar_minus_gnss_s")),
        (Seen(constants=LEVER), Cause.LEVER_ARM, ("-0.60 m", "+0.80 m", "lever arm of the antenna")),
        # Errors of the positions on the map's axes alone look like either, but explain the residuals much better.
        (Seen(constants=LEVER, slow_gain=1e6), Cause.UNKNOWN, ("-0.60 m", "the positions themselves may be wrong")),
        (Seen(constants=LEVER, slow_gain=1e5), Cause.LEVER_ARM, ("lever arm of the antenna",)),
        (Seen(constants=EITHER), Cause.CLOCK_OR_LEVER_ARM, ("does not separate",)),
        (Seen(ground=GroundTilt(178.0, upside_down=True)), Cause.UPSIDE_DOWN, ("178°", "upside down")),
        (Seen(ground=GroundTilt(60.0)), Cause.MOUNTING, ("60°", "mounting of the scanner")),
        (Seen(ground=BACKWARDS), Cause.MOUNTING, ("turned by +180°", "mounting of the scanner")),
        (Seen(ground=GroundTilt(60.0, model=HI_RES), sway=SWAY), Cause.MODEL, ("of a VLP-16", "of a Puck Hi-Res")),
        (Seen(slow_times=4.0, creep_mps=0.006), Cause.POSITIONS, ("heights creep by +0.36 m a minute",)),
        (Seen(sway=SWAY), Cause.LEVER_ARM, ("further up by +0.500 ± 0.020 m (95 %)",)),
        (Seen(sway=SWAY_LATE), Cause.CLOCK, ("-1.00 s apart",)),
        (Seen(sway=SWAY_ALONE), Cause.CLOCK_OR_LEVER_ARM, ("does not separate",)),
        (Seen(slip=5.0, lever_m=(1.85, 0.0, 1.62)), Cause.LEVER_ARM, ("[1.85, 0, 1.62]",)),
    ],
)
def test_cause__is_named_in_the_notice(seen: Seen, cause: Cause | None, words: tuple[str, ...]) -> None:
    assert seen.cause == cause
    assert seen.plain()["consistent"] == (cause is None)
    notice = contradiction_notice(seen)
    assert (notice is None) == (cause is None)
    for word in words:
        assert notice is not None
        assert word in notice.text


@pytest.mark.parametrize(
    ("seen", "factor"),
    [
        (Seen(slip=1.4), 1.0),
        (Seen(slip=2.8, drift=5.9), 2.0),
        (Seen(slip=2.7, drift=6.0), 2.0),
        (Seen(slip=1.0, drift=1.0, ground=GroundTilt(60.0)), 3.0),
        (Seen(constants=CLOCK), np.sqrt(1e5 / 50.0)),
        (Seen(constants=LEVER), np.sqrt(1e5 / 50.0)),
        (Seen(constants=AntennaConstants(clock_gain=1e5)), 0.0),
        (Seen(sway=AntennaSway(lever_m=(0.3, -0.8, 0.1), sigma_m=(0.1, 0.1, 0.1))), 2.0),
    ],
)
def test_factor__is_the_largest_ratio_to_what_is_allowed(seen: Seen, factor: float) -> None:
    """1.4 times the slip of wheels, 3 times the stated drift, 20°, a gain of 50, 4 standard deviations."""
    assert seen.factor == pytest.approx(factor)
    assert seen.plain()["factor"] == pytest.approx(factor, abs=0.005)
    assert (seen.cause is None) == (factor <= 1.0)


@pytest.mark.parametrize(
    ("slip", "drift", "words", "missing"),
    [(1.41, 1.0, "slips", "drift"), (1.0, 3.01, "drift", "slips"), (1.39, 9.0, "drift", "slips")],
)
def test_notice__tells_only_what_is_beyond_its_limit(slip: float, drift: float, words: str, missing: str) -> None:
    notice = contradiction_notice(Seen(slip=slip, drift=drift))
    assert notice is not None
    shown = notice.text.partition("The likely")[0].partition("Lever arm")[0]
    assert words in shown
    assert missing not in shown


def test_notice__of_a_sway_tells_the_axes_that_are_certain() -> None:
    sway = AntennaSway(lever_m=(0.39, -0.41, 0.5), sigma_m=(0.1, 0.1, 0.2))
    notice = contradiction_notice(Seen(sway=sway))
    assert notice is not None
    assert "次の位置のものです：左へ -0.41 ± 0.20 m（95 %）。原因として" in notice.text_in("ja")
    assert "one that is further left by -0.41 ± 0.20 m (95 %)." in notice.text


@pytest.mark.parametrize(
    ("constants", "off"),
    [
        (AntennaConstants(clock_s=0.011, clock_gain=51.0), True),
        (AntennaConstants(clock_s=-0.011, clock_gain=51.0), True),
        (AntennaConstants(clock_s=0.009, clock_gain=51.0), False),
        (AntennaConstants(clock_s=0.011, clock_gain=49.0), False),
        (AntennaConstants(lever_m=(0.019, 0.025), lever_gain=51.0), True),
        (AntennaConstants(lever_m=(0.017, 0.023), lever_gain=51.0), False),
        (AntennaConstants(lever_m=(0.019, 0.025), lever_gain=49.0), False),
    ],
)
def test_constants__are_off_beyond_10_ms_or_3_cm_and_a_gain_of_50(constants: AntennaConstants, off: bool) -> None:
    assert constants.off is off
    assert (Seen(constants=constants).cause is not None) is off


@pytest.mark.parametrize(
    ("clock_gain", "lever_gain", "cause"),
    [
        (151.0, 100.0, Cause.CLOCK),
        (149.0, 100.0, Cause.CLOCK_OR_LEVER_ARM),
        (100.0, 149.0, Cause.CLOCK_OR_LEVER_ARM),
        (100.0, 151.0, Cause.LEVER_ARM),
    ],
)
def test_cause__is_what_explains_half_as_much_again(clock_gain: float, lever_gain: float, cause: Cause) -> None:
    constants = AntennaConstants(clock_s=0.4, lever_m=(0.5, 0.0), clock_gain=clock_gain, lever_gain=lever_gain)
    assert Seen(constants=constants).cause == cause


@pytest.mark.parametrize(("sigma_m", "known"), [((0.49, 0.1, 9.0), True), ((0.1, 0.51, 0.1), False)])
def test_sway__shows_the_place_where_half_a_metre_is_known(sigma_m: tuple[float, float, float], known: bool) -> None:
    assert AntennaSway(sigma_m=sigma_m).known is known


@pytest.mark.parametrize(("off_m", "refuted"), [(0.19, False), (0.21, True), (-0.21, True)])
@pytest.mark.parametrize("axis", [0, 1])
def test_sway__refutes_a_lever_arm_four_standard_deviations_away(axis: int, off_m: float, refuted: bool) -> None:
    sway = AntennaSway(lever_m=(0.1, 0.1, 0.0), sigma_m=(0.03, 0.03, 0.03))
    lever_m = tuple(0.1 + off_m * (k == axis) for k in range(2))
    assert sway.refutes((lever_m[0], lever_m[1]), (0.04, 0.04)) is refuted


def straight(n: int = 5, speed_mps: float = 2.0) -> Trajectory:
    t_s = np.arange(float(n))
    zero = np.zeros(n)
    quaternion = np.zeros((n, 4))
    quaternion[:, 0] = 1.0
    return Trajectory(
        t_s=t_s,
        xyz_m=np.column_stack([speed_mps * t_s, zero, zero]),
        quaternion=quaternion,
        sigma=np.tile([0.03, 0.03, 0.04, 0.1, 0.1, 0.2], (n, 1)),
        speed_mps=np.full(n, speed_mps),
        motion=np.ones(n, np.int8),
        fix=np.full(n, 4, np.int8),
        heading_from=np.full(n, "gnss"),
        position_from=np.full(n, "gnss"),
        height_from=np.full(n, "gnss"),
        level_from=np.full(n, "assumed"),
        max_gap_s=1.0,
    )


LEVER_M, SENSOR_M = np.array([1.0, 0.0, 2.0]), np.array([-0.6, 0.0, 2.5])


@pytest.mark.parametrize(
    ("seen", "place_m", "turn_deg"),
    [
        (Seen(constants=CLOCK), 0.4 * 2.0, 0.0),  # by the way of 0.4 s
        (Seen(constants=LEVER), 1.0, 0.0),
        (Seen(sway=SWAY), 0.5, 0.0),
        (Seen(sway=SWAY_LATE), 0.0, 0.0),
        (Seen(slip=5.0, lever_m=(1.0, 0.3, 2.4)), 0.5, 0.0),
        (Seen(ground=GroundTilt(60.0)), 2.0 * np.hypot(0.6, 2.5), 60.0),
    ],
)
def test_sigmas__grow_to_what_the_cause_moves(seen: Seen, place_m: float, turn_deg: float) -> None:
    drive = straight()
    found = enlarge_sigmas(drive, seen, LEVER_M, SENSOR_M, turned_deg=1.5).sigma
    grown = drive.sigma * seen.factor
    np.testing.assert_allclose(found[:, :3], np.hypot(grown[:, :3], place_m))
    np.testing.assert_allclose(found[:, 3:5], np.hypot(grown[:, 3:5], turn_deg))
    np.testing.assert_allclose(found[:, 5], np.hypot(grown[:, 5], 1.5))


def test_sigmas__of_headings_hold_a_scanner_that_faces_backwards() -> None:
    found = enlarge_sigmas(straight(), Seen(ground=BACKWARDS), LEVER_M, SENSOR_M).sigma
    np.testing.assert_allclose(found[:, 5], np.hypot(straight().sigma[:, 5], 180.0))


def test_sigmas__of_an_unknown_cause_hold_a_lever_arm_that_the_sway_leaves_open() -> None:
    """And headings turn by what the axle slips, twice the 3 % of wheels."""
    drive, seen = straight(), Seen(slip=2.0, sway=AntennaSway((0.3, 0.0, 0.0), (0.4, np.inf, np.inf)))
    assert seen.cause is Cause.UNKNOWN
    found, grown = enlarge_sigmas(drive, seen, LEVER_M, SENSOR_M).sigma, drive.sigma * seen.factor
    np.testing.assert_allclose(found[:, :3], np.hypot(grown[:, :3], 0.5))
    np.testing.assert_allclose(found[:, 5], np.hypot(grown[:, 5], np.degrees(0.06)))


def test_sigmas__stay_where_nothing_contradicts() -> None:
    drive = straight()
    assert enlarge_sigmas(drive, Seen(slip=1.2), LEVER_M, SENSOR_M) is drive


def test_clock_notice__names_leap_seconds_and_what_to_state() -> None:
    text = clock_notice(0.5, -18.0, 0.002).text
    assert "18.000 s behind" in text
    assert "lidar_minus_gnss_s = -17.500" in text
    assert "leap" in text
    assert "0.400 s ahead of" in clock_notice(0.0, 0.4, 0.002).text
