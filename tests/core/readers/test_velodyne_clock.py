"""Device stamps to UTC: hours, midnights, locks, jumps, and recorders that lie."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.readers.spinning.hour_clock import PositionPacket, SensorClock, settle
from furrowmap.core.values.scan import Clock
from tests.core.readers.velodyne_packets import position_packet, rmc

HOUR = 3600.0
T0 = dt.datetime(2026, 6, 11, 1, 23, 41, tzinfo=dt.UTC).timestamp()
AHEAD_S = 0.83
"""The recorder's clock in these tests is this much ahead of UTC."""


def stamps(t_s: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Microseconds past the hour."""
    return (np.round(t_s * 1e6) % 3_600_000_000).astype(np.uint32)


def position(
    t_s: float, *, pps: int = 2, status: str = "A", dated: bool = True, device_s: float | None = None
) -> PositionPacket:
    """The position packet that a sensor would send at UTC `t_s`, with the sentence of the second before."""
    second = dt.datetime.fromtimestamp(int(t_s), tz=dt.UTC)
    sentence = rmc(second.strftime("%H%M%S"), second.strftime("%d%m%y") if dated else "", status)
    return PositionPacket.parse(
        position_packet((t_s if device_s is None else device_s) % HOUR * 1e6, sentence, pps), t_s + AHEAD_S
    )


def every(count: int, t_s: float = T0, step_s: float = 1.327e-3) -> NDArray[np.float64]:
    return t_s + np.arange(count) * step_s


def test_position_packet__of_a_real_sensor(shared_data: Path) -> None:
    content = (shared_data / "velodyne" / "vlp16_single_gps.pcap").read_bytes()
    at = content.index(b"$GPRMC") - 206
    found = PositionPacket.parse(content[at : at + 512], 1453364282.709121)
    assert found.device_s == 1082.342001
    assert found.pps == 2
    assert found.valid
    assert found.sentence_s == dt.datetime(2016, 1, 21, 8, 18, 2, tzinfo=dt.UTC).timestamp()
    assert found.lat_deg == pytest.approx(36 + 49.7478558 / 60, abs=1e-12)
    assert found.lon_deg == pytest.approx(-(2 + 24.4542928 / 60), abs=1e-12)
    assert found.utc_s(0.0) == pytest.approx(1453364282.342001, abs=1e-6)


@pytest.mark.parametrize(
    "sentence",
    [
        "",
        "$GPRMC,,V,,,,,,,,,,N*53\r\n",
        rmc().replace("*7", "*0"),
        rmc()[:30],
        rmc(time="256199"),
        rmc(date="320126"),
        "$GPGGA,012341,3652.2039,N,14001.2103,E,1,08,1.0,200.0,M,37.0,M,,*5C\r\n",
        "\xff\xfe$GPRMC,\x00\x01",
    ],
)
def test_position_packet__of_no_use_is_not_valid(sentence: str) -> None:
    found = PositionPacket.parse(position_packet(1421e6, "")[:206] + sentence.encode("latin1").ljust(306, b"\0"), T0)
    assert not found.valid
    assert found.utc_s(T0) is None


@given(st.binary(min_size=512, max_size=512))
def test_position_packet__of_any_bytes_is_no_exception(payload: bytes) -> None:
    assert PositionPacket.parse(payload, T0).device_s < 4295.0


def test_settle__takes_the_hour_from_the_sentences() -> None:
    t_s = every(100)
    clock, notices = settle(stamps(t_s), t_s + AHEAD_S, [position(T0 + 0.4)])
    assert clock.kind is Clock.SENSOR_GPS
    assert notices == []
    np.testing.assert_allclose(clock.utc_s(stamps(t_s), t_s + AHEAD_S), t_s, atol=1e-6)


def test_settle__a_recorder_an_hour_and_more_off_does_not_matter() -> None:
    t_s = every(100)
    packet = position(T0 + 0.4)
    for off_s in (-5000.0, 9 * HOUR, 1e6):
        late = replace(packet, host_s=packet.host_s + off_s)
        clock, _ = settle(stamps(t_s), t_s + AHEAD_S + off_s, [late])
        np.testing.assert_allclose(clock.utc_s(stamps(t_s), t_s + AHEAD_S + off_s), t_s, atol=1e-6)


def test_settle__sentences_without_a_date_take_the_recorders_or_a_stated_day() -> None:
    t_s = every(100)
    packets = [position(T0 + 0.4, dated=False)]
    clock, _ = settle(stamps(t_s), t_s + AHEAD_S, packets)
    np.testing.assert_allclose(clock.utc_s(stamps(t_s), t_s + AHEAD_S), t_s, atol=1e-6)
    no_date = [replace(packets[0], host_s=packets[0].host_s - T0)]
    clock, _ = settle(stamps(t_s), t_s - T0, no_date, near_s=T0 + 5 * HOUR)
    np.testing.assert_allclose(clock.utc_s(stamps(t_s), t_s - T0), t_s, atol=1e-6)


@pytest.mark.parametrize("over", ["2026-06-11T02:00:00", "2026-06-12T00:00:00", "2025-01-01T00:00:00"])
def test_utc__runs_over_the_hour_midnight_and_new_year(over: str) -> None:
    t_s = every(3000, dt.datetime.fromisoformat(over).replace(tzinfo=dt.UTC).timestamp() - 2.0)
    clock, _ = settle(stamps(t_s[:100]), t_s[:100] + AHEAD_S, [position(float(t_s[50]))])
    found = np.concatenate([clock.utc_s(stamps(part), part + AHEAD_S) for part in np.array_split(t_s, 7)])
    np.testing.assert_allclose(found, t_s, atol=1e-6)
    assert clock.jumps == []


def test_utc__bridges_pauses_of_hours() -> None:
    t_s = np.concatenate([every(50), every(50, T0 + 3 * HOUR + 1000), every(50, T0 + 30 * HOUR)])
    for positions in ([position(T0)], []):
        clock, _ = settle(stamps(t_s[:50]), t_s[:50], positions)
        np.testing.assert_allclose(np.diff(clock.utc_s(stamps(t_s), t_s)), np.diff(t_s), atol=2e-6)
        assert clock.jumps == []


def test_settle__void_or_no_sentences_leave_the_recorders_clock() -> None:
    t_s = every(2000)
    device = stamps(t_s - 777.0)
    jitter = np.random.default_rng(0).exponential(0.0003, len(t_s))
    for positions, words in (
        ([], "There are no position packets"),
        ([position(T0 + 0.1, status="V", pps=0)], "void (PPS absent)"),
        ([PositionPacket.parse(position_packet(5e6, "", 0), T0)], "have no GPRMC sentence"),
        ([position(T0 + 0.1, device_s=5.0)], "do not match the GPRMC sentences"),
    ):
        clock, (notice,) = settle(device, t_s + jitter, positions)
        assert clock.kind is Clock.RECORDER
        assert notice.code == "clock-recorder"
        assert words in notice.text
        assert "differ by 777.0 s" in notice.text
        found = clock.utc_s(device, t_s + jitter)
        np.testing.assert_allclose(found - t_s, np.median(jitter), atol=3e-6)


@pytest.mark.parametrize("ahead_s", [-1.7, -0.4, 0.831])
def test_settle__takes_stamps_that_fit_the_recorder_s_hour_as_set_by_gps(ahead_s: float) -> None:
    t_s = every(100)
    clock, (notice,) = settle(stamps(t_s), t_s + ahead_s, [])
    assert clock.kind is Clock.SENSOR
    assert notice.code == "clock-sensor"
    assert f"{ahead_s:+.3f} s" in notice.text
    np.testing.assert_allclose(clock.utc_s(stamps(t_s), t_s + ahead_s), t_s, atol=1e-6)


def test_settle__reports_where_the_recorder_set_the_stamps() -> None:
    t_s = every(100)
    clock, (notice,) = settle(stamps(t_s - 0.02), t_s, [])
    assert clock.kind is Clock.RECORDER
    assert "match its time past the hour within 0.020 s" in notice.text


def test_utc__relative_times_are_the_devices_though_the_recorder_runs_slow() -> None:
    """As in a bag whose host times were evened out: 50 ms gaps in device time that the recorder does not show."""
    device_s = np.concatenate([every(80, 625.659 + 0.1 * i, 0.66e-3) for i in range(5)])
    host_s = np.linspace(T0, T0 + 0.225, len(device_s))
    clock, _ = settle(stamps(device_s), host_s, [])
    found = clock.utc_s(stamps(device_s), host_s)
    np.testing.assert_allclose(np.diff(found), np.diff(device_s), atol=1.1e-6)
    assert abs(np.median(found - host_s)) < 1e-6


def test_utc__a_clock_that_gets_its_lock_on_the_way_is_put_right_before_and_after() -> None:
    t_s = every(4000)
    locked = t_s > T0 + 2.0
    device = np.where(locked, stamps(t_s), stamps(t_s - T0 + 37.0)).astype(np.uint32)
    positions = [position(T0 + 0.5, status="V", pps=0, device_s=37.5), position(T0 + 2.5)]
    clock, notices = settle(device[:500], t_s[:500] + AHEAD_S, positions)
    assert clock.kind is Clock.SENSOR_GPS
    assert [n.code for n in notices] == ["clock-before-lock"]
    assert "-0.830 s" in notices[0].text
    found = np.concatenate(
        [clock.utc_s(d, h) for d, h in zip(np.split(device, 8), np.split(t_s + AHEAD_S, 8), strict=True)]
    )
    np.testing.assert_allclose(found, t_s, atol=2e-6)
    ((at_s, size_s),) = clock.jumps
    assert at_s == pytest.approx(T0 + 2.0, abs=0.002)
    assert size_s == pytest.approx((T0 % HOUR) - 37.0, abs=0.01)


def test_utc__one_damaged_stamp_spoils_no_other() -> None:
    t_s = every(1000)
    device = stamps(t_s)
    device[400] = 4_000_000_000
    for positions in ([position(T0)], []):
        clock, _ = settle(device[:100], t_s[:100], positions)
        found = clock.utc_s(device, t_s)
        np.testing.assert_allclose(np.delete(found, 400), np.delete(t_s, 400), atol=2e-6)
        assert len(clock.jumps) == 2


def test_utc__a_damaged_first_stamp_spoils_no_other() -> None:
    t_s = every(1000)
    device = stamps(t_s)
    device[0] = 4_000_000_000
    clock, _ = settle(device, t_s, [])
    np.testing.assert_allclose(clock.utc_s(device, t_s)[1:], t_s[1:], atol=2e-6)


def test_utc__a_restarted_sensor_runs_on_by_the_recorder() -> None:
    t_s = np.concatenate([every(500), every(500, T0 + 20.0)])
    device = np.concatenate([stamps(t_s[:500]), stamps(t_s[500:] - t_s[500] + 4.0)])
    clock, _ = settle(device[:500], t_s[:500], [])
    np.testing.assert_allclose(clock.utc_s(device, t_s), t_s, atol=2e-6)
    assert len(clock.jumps) == 1


def test_utc__a_recorder_set_right_on_the_way_changes_nothing() -> None:
    t_s = every(1000)
    host_s = t_s + np.where(np.arange(1000) < 500, 0.0, 1e6)
    clock, _ = settle(stamps(t_s[:300]), host_s[:300], [])
    np.testing.assert_allclose(clock.utc_s(stamps(t_s), host_s), t_s, atol=2e-6)


def test_settle__a_recorder_without_a_clock_takes_a_stated_hour() -> None:
    t_s = every(100)
    clock, (notice,) = settle(stamps(t_s), t_s - T0, [], near_s=T0 + 600.0)
    assert clock.kind is Clock.STATED
    assert notice.code == "clock-stated"
    np.testing.assert_allclose(clock.utc_s(stamps(t_s), t_s - T0), t_s, atol=1e-6)


@given(
    start_s=st.floats(1e9, 2e9),
    gaps=st.lists(st.floats(1e-4, 3000.0), min_size=1, max_size=30),
    off_s=st.floats(-100.0, 100.0),
    jitter_ms=st.integers(0, 400),
)
def test_utc__of_any_recording_of_a_locked_sensor_is_true(
    start_s: float, gaps: list[float], off_s: float, jitter_ms: int
) -> None:
    """Whatever the pauses and the recorder's offset and jitter: UTC to the microsecond."""
    t_s = np.round(start_s + np.cumsum([0.0, *gaps]), 6)
    host_s = t_s + off_s + np.random.default_rng(jitter_ms).random(len(t_s)) * jitter_ms * 1e-3
    fix = position(float(t_s[0]))
    fix = replace(fix, host_s=float(host_s[0]))
    clock, _ = settle(stamps(t_s[:1]), host_s[:1], [fix])
    np.testing.assert_allclose(clock.utc_s(stamps(t_s), host_s), t_s, atol=2e-6)
    assert clock.jumps == []


def test_sensor_clock__of_no_packets_gives_no_times() -> None:
    assert len(SensorClock(Clock.RECORDER, 0.0, 0.0).utc_s(np.empty(0, np.uint32), np.empty(0))) == 0


@pytest.mark.parametrize(
    ("ahead_s", "kind"),
    [
        (0.049, Clock.RECORDER),
        (-0.049, Clock.RECORDER),
        (0.051, Clock.SENSOR),
        (-0.051, Clock.SENSOR),
        (1.99, Clock.SENSOR),
        (-1.99, Clock.SENSOR),
        (2.01, Clock.RECORDER),
        (-2.01, Clock.RECORDER),
    ],
)
def test_settle__stamps_within_two_seconds_of_the_hour_but_not_of_the_recorder_are_of_gps(
    ahead_s: float, kind: Clock
) -> None:
    t_s = every(100)
    clock, (notice,) = settle(stamps(t_s), t_s + ahead_s, [])
    assert clock.kind is kind
    if kind is Clock.RECORDER:
        words = "match its time past the hour within 0.049" if abs(ahead_s) < 1.0 else "differ by 2.0 s"
        assert words in notice.text


@pytest.mark.parametrize(("late_s", "is_tied"), [(1.99, True), (-1.99, True), (2.01, False), (-2.01, False)])
def test_position_packet__and_its_sentence_are_of_the_same_two_seconds(late_s: float, is_tied: bool) -> None:
    found = position(T0, device_s=T0 + late_s).utc_s(T0)
    assert found == (pytest.approx(T0 + late_s, abs=1e-6) if is_tied else None)


@pytest.mark.parametrize(
    ("jump_s", "jumps"), [(0.24, 0), (0.26, 0), (1.9, 0), (2.1, 1), (-0.019, 0), (-0.021, 0), (-1.9, 0), (-2.1, 1)]
)
def test_utc__a_step_of_more_than_two_seconds_against_the_recorder_is_a_jump(jump_s: float, jumps: int) -> None:
    """Of the sensor's stamps alone; smaller ones are the recorder's delays."""
    t_s = every(200)
    told_s = np.where(np.arange(200) < 100, t_s, t_s + jump_s)
    clock, _ = settle(stamps(t_s[:50]), t_s[:50] + AHEAD_S, [position(T0)])
    found = clock.utc_s(stamps(told_s), t_s + AHEAD_S)
    np.testing.assert_allclose(found, t_s if jumps else told_s, atol=1e-5)
    assert clock.jumps == [(pytest.approx(t_s[100]), pytest.approx(jump_s, abs=1e-5))] * jumps


@pytest.mark.parametrize(("year", "kind"), [(1999, Clock.STATED), (2000, Clock.RECORDER)])
def test_settle__a_recorder_before_2000_has_no_clock(year: int, kind: Clock) -> None:
    new_year_s = dt.datetime(2000, 1, 1, tzinfo=dt.UTC).timestamp()
    host_s = every(100, new_year_s + (10.0 if year == 2000 else -10.0))
    t_s = every(100)
    clock, _ = settle(stamps(t_s), host_s, [], near_s=T0 + 600.0)
    assert clock.kind is kind
    if kind is Clock.STATED:
        np.testing.assert_allclose(clock.utc_s(stamps(t_s), host_s), t_s, atol=1e-6)


@pytest.mark.parametrize(
    ("time", "seconds", "is_valid"),
    [("235959", 86_399.0, True), ("235959.75", 86_399.75, True), ("240000", 86_400.0, False), ("000000", 0.0, True)],
)
def test_position_packet__has_a_time_of_day(time: str, seconds: float, is_valid: bool) -> None:
    found = PositionPacket.parse(position_packet(5e6, rmc(time, ""), 2), T0)
    assert (found.sentence_s, found.valid) == (seconds, is_valid)
