from __future__ import annotations

import struct
from functools import cache
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.readers.las.cloud import CloudFile, open_cloud, survey
from furrowmap.core.readers.las.point_records import CloudBatch, TimeKind
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import las_time_to_utc

# Points, CRS by EPSG code or name, kind of time: from the collection's own list.
GOOD: dict[str, tuple[int, int | str | None, TimeKind]] = {
    "ellipsoid.copc.laz": (100_000, 3857, TimeKind.WEEK),
    "las10_pf0_geotiff.las": (1, 26915, TimeKind.NONE),
    "las11_pf1_etrs89_utm32.laz": (5658, 5972, TimeKind.STANDARD),
    "las11_pf1_geotiff.las": (1, 26915, TimeKind.UNKNOWN),
    "las12_pf0_geographic4326.las": (5380, 4326, TimeKind.NONE),
    "las12_pf0_geotiff_utm10.las": (1065, 26910, TimeKind.NONE),
    "las12_pf1_ftus_mississippi.las": (6280, "NAD83 / Mississippi West + unknown", TimeKind.WEEK),
    "las12_pf2_nocrs.las": (1065, None, TimeKind.NONE),
    "las12_pf3_autzen_trim.laz": (110_000, 2994, TimeKind.WEEK),
    "las12_pf3_geotiff_utm10.las": (1065, 26910, TimeKind.WEEK),
    "las12_pf3_nocrs.las": (1065, None, TimeKind.WEEK),
    "las12_pf3_nocrs.laz": (1065, None, TimeKind.WEEK),
    "las12_pf3_poland_crs_error.las": (3000, None, TimeKind.STANDARD),
    "las13_no_points.laz": (0, None, TimeKind.NONE),
    "las13_pf1_nocrs.las": (10_683, None, TimeKind.WEEK),
    "las13_pf4_waveform_hdrbox_lies.las": (999, None, TimeKind.WEEK),
    "las14_pf3_extrabytes.las": (1065, None, TimeKind.WEEK),
    "las14_pf6_both_wkt_and_geotiff.las": (25_408, "NAD83_2011_Nebraska_ft", TimeKind.STANDARD),
    "las14_pf6_evlr.laz": (1000, "NAD83(HARN) / New Mexico Central (ftUS)", TimeKind.STANDARD),
    "las14_pf6_wkt_ftus.las": (1000, "NAD83(HARN) / New Mexico Central (ftUS)", TimeKind.STANDARD),
    "las14_pf7_wkt_compound_gpstime.las": (687, "NAD83 / Oregon LCC (m) + NAVD88 height (ftUS)", TimeKind.STANDARD),
    "las14_pf8_wkt_rgf93.laz": (37_805, 2154, TimeKind.STANDARD),
    "small.copc.laz": (1065, "NAD83 / Oregon LCC (m) + NAVD88 height (ftUS)", TimeKind.WEEK),
    "small_with_page.copc.laz": (1065, "NAD83 / Oregon LCC (m) + NAVD88 height (ftUS)", TimeKind.WEEK),
    "tiny4326.copc.laz": (28, 4326, TimeKind.STANDARD),
}


@pytest.fixture(scope="module")
def good(shared_data: Path) -> Path:
    return shared_data / "las" / "good"


def whole(cloud: CloudFile, batch_points: int = 10_000) -> CloudBatch:
    """All points as one batch."""
    batches = list(cloud.batches(batch_points=batch_points))
    joined = {
        name: None if getattr(batches[0], name) is None else np.concatenate([getattr(batch, name) for batch in batches])
        for name in vars(batches[0])
    }
    return CloudBatch(**joined)


def test_good__are_all_known(good: Path) -> None:
    assert {path.name for path in good.iterdir()} == GOOD.keys()


@pytest.mark.parametrize("name", GOOD)
def test_good__whole_and_as_laspy_reads_them(good: Path, name: str) -> None:
    points, crs, time = GOOD[name]
    cloud = open_cloud(good / name)
    assert (cloud.points, cloud.clock) == (points, time)
    stated = cloud.crs
    assert crs is None if stated is None else crs in (stated.to_epsg(), stated.name)
    if points == 0:
        assert list(cloud.batches()) == []
        return
    ours, theirs = whole(cloud), laspy.read(good / name)
    assert len(ours) == points
    np.testing.assert_array_equal(ours.xyz_m, theirs.xyz)
    for own, name_of_it in (
        (ours.classification, "classification"),
        (ours.intensity, "intensity"),
        (ours.return_number, "return_number"),
        (ours.returns, "number_of_returns"),
        (ours.point_source_id, "point_source_id"),
        (ours.withheld, "withheld"),
    ):
        np.testing.assert_array_equal(own, np.asarray(theirs[name_of_it]), err_msg=name_of_it)
    if ours.rgb is not None:
        np.testing.assert_array_equal(ours.rgb, np.stack([theirs.red, theirs.green, theirs.blue], axis=1))
    if time in (TimeKind.WEEK, TimeKind.STANDARD):
        np.testing.assert_array_equal(ours.gps_time, np.asarray(theirs.gps_time))
    if time is TimeKind.STANDARD:
        np.testing.assert_allclose(ours.t_s, las_time_to_utc(theirs.gps_time), rtol=0, atol=1e-6)
    assert (ours.t_s is None) == (time is not TimeKind.STANDARD)
    assert cloud.dimensions == (*dict.fromkeys(dimension for dimension in cloud.dimensions),)


def test_good__extra_dimensions_are_named_as_laspy_names_them(good: Path) -> None:
    with laspy.open(good / "las14_pf3_extrabytes.las") as theirs:
        expected = list(theirs.header.point_format.extra_dimension_names)
    assert [dimension.name for dimension in open_cloud(good / "las14_pf3_extrabytes.las").extra] == expected
    # Described in two records, of which laspy takes the first.
    assert [dimension.name for dimension in open_cloud(good / "las14_pf8_wkt_rgf93.laz").extra] == [
        "Deviation",
        "confidence",
    ]


def test_good__only_true_errors_are_reported(good: Path) -> None:
    by_file = {}
    for name in GOOD:
        cloud = open_cloud(good / name)
        by_file[name] = {notice.code for notice in (*cloud.notices, *survey(cloud).notices())}
    assert {name: codes for name, codes in by_file.items() if codes} == {
        "ellipsoid.copc.laz": {"creation-date"},
        "las11_pf1_geotiff.las": {"gps-time-impossible"},  # POSIX seconds of the day on which the file was made
        "las12_pf0_geographic4326.las": {"returns-differ"},
        "las12_pf3_poland_crs_error.las": {"crs-unreadable"},
        "las13_pf4_waveform_hdrbox_lies.las": {"crs-unreadable", "header-box"},
        "las14_pf6_both_wkt_and_geotiff.las": {"gps-time-type"},
        "las14_pf7_wkt_compound_gpstime.las": {"gps-time-type"},
        "small.copc.laz": {"creation-date"},
        "small_with_page.copc.laz": {"creation-date"},
        "tiny4326.copc.laz": {"gps-time-type"},
    }


def test_batches__are_bounded_and_in_the_file_s_order(good: Path) -> None:
    cloud = open_cloud(good / "las13_pf1_nocrs.las")
    batches = list(cloud.batches(batch_points=1000))
    assert [len(batch) for batch in batches] == [1000] * 10 + [683]
    np.testing.assert_array_equal(np.concatenate([b.xyz_m for b in batches]), laspy.read(cloud.path).xyz)


@cache
def opened(path: Path) -> tuple[CloudFile, np.ndarray]:
    """A cloud, and its points as laspy reads them."""
    return open_cloud(path), laspy.read(path).xyz


@pytest.mark.parametrize("name", ["ellipsoid.copc.laz", "small_with_page.copc.laz", "las12_pf3_nocrs.las"])
@given(corners=st.tuples(*[st.floats(0, 1)] * 4))
@settings(max_examples=12)
def test_box__gives_the_points_in_it_and_no_others(good: Path, name: str, corners: tuple[float, ...]) -> None:
    cloud, xyz = opened(good / name)
    (west, south), (east, north) = xyz[:, :2].min(axis=0), xyz[:, :2].max(axis=0)
    x, y = sorted(corners[:2]), sorted(corners[2:])
    box = (
        west + x[0] * (east - west),
        south + y[0] * (north - south),
        west + x[1] * (east - west),
        south + y[1] * (north - south),
    )
    inside = np.all((xyz[:, :2] >= box[:2]) & (xyz[:, :2] <= box[2:]), axis=1)
    ours = [batch.xyz_m for batch in cloud.batches(box=box)]
    got = np.concatenate(ours) if ours else np.empty((0, 3))
    np.testing.assert_array_equal(got[np.lexsort(got.T)], xyz[inside][np.lexsort(xyz[inside].T)])


def test_resolution__coarser_levels_of_copc_as_laspy_takes_them(good: Path) -> None:
    path = good / "ellipsoid.copc.laz"
    cloud = open_cloud(path)
    assert cloud.index is not None
    with laspy.CopcReader.open(path) as theirs:
        expected = [len(theirs.query(resolution=cloud.index.spacing / by)) for by in (1.0, 2.5)]
    assert expected[0] < expected[1] == cloud.points
    ours = [sum(map(len, cloud.batches(resolution=cloud.index.spacing / by))) for by in (1.0, 2.5)]
    assert ours == expected


def test_large_chunk__is_streamed(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("las12_pf3_autzen_trim.laz", "ellipsoid.copc.laz"):
        expected = whole(open_cloud(good / name)).xyz_m
        monkeypatch.setattr("furrowmap.core.readers.las.laz.LARGEST_CHUNK_BYTES", 1000)
        cloud = open_cloud(good / name)
        batches = [batch.xyz_m for batch in cloud.batches(batch_points=7000)]
        assert max(map(len, batches)) == 7000
        np.testing.assert_array_equal(np.concatenate(batches), expected)
        monkeypatch.undo()


def patched(path: Path, source: Path, at: int, layout: str, *values: float) -> Path:
    data = bytearray(source.read_bytes())
    struct.pack_into(layout, data, at, *values)
    path.write_bytes(data)
    return path


def test_layers__lengths_that_do_not_fill_the_chunk_are_refused(good: Path, tmp_path: Path) -> None:
    source = good / "las14_pf6_evlr.laz"
    at = open_cloud(source).header.offset + 8 + 30 + 4  # the length of the chunk's first layer
    path = patched(tmp_path / "cloud.laz", source, at, "<I", 0xFFFF_FFFF)
    with pytest.raises(InputError, match=r"chunk 1") as refused:
        open_cloud(path)
    assert refused.value.code == "laz-damaged"


def test_week_times_called_standard__are_taken_for_week_times(good: Path, tmp_path: Path) -> None:
    path = patched(tmp_path / "cloud.las", good / "las12_pf3_geotiff_utm10.las", 6, "<H", 1)
    cloud = open_cloud(path)
    assert cloud.clock is TimeKind.WEEK
    assert "gps-time-type" in {notice.code for notice in cloud.notices}
    assert next(cloud.batches()).t_s is None


def test_two_crs__the_one_that_the_header_announces_is_used_and_the_other_reported(good: Path, tmp_path: Path) -> None:
    source = good / "las14_pf6_both_wkt_and_geotiff.las"
    said = b'PARAMETER["central_meridian",-100]'
    assert said in source.read_bytes()
    (tmp_path / "cloud.las").write_bytes(source.read_bytes().replace(said, said.replace(b"-100", b"-101")))
    cloud = open_cloud(tmp_path / "cloud.las")
    assert cloud.header.crs_is_wkt
    assert cloud.crs is not None
    assert cloud.crs.name == "NAD83_2011_Nebraska_ft"
    assert "-101" in cloud.crs.to_wkt()
    assert [notice.code for notice in cloud.notices if notice.code.startswith("crs")] == ["crs-contradiction"]


def test_not_there__is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        open_cloud(tmp_path / "cloud.laz")
    with pytest.raises(InputError, match="is a folder"):
        open_cloud(tmp_path)
