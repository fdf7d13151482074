from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from furrowmap.core.readers.las.cloud import open_cloud, survey

ADDRESS_SPACE = 3 << 30
SECONDS = 2.0
PEAK_KB = 300_000

ERRORS = {
    "d_bad_signature.las": "not-las",
    "d_empty_file.las": "not-las",
    "d_laz12_claims_4294967295_points.laz": "laz-damaged",
    "d_laz14_claims_1e12_points.laz": "laz-damaged",
    "d_laz_chunk_size_zero.laz": "laz-damaged",
    "d_laz_chunk_table_4294967295_chunks.laz": "laz-damaged",
    "d_laz_chunk_table_empty.laz": "laz-damaged",
    "d_laz_chunk_table_garbage.laz": "laz-damaged",
    "d_laz_chunk_table_offset_beyond_end.laz": "laz-damaged",
    "d_laz_claims_60000_items.laz": "laz-damaged",
    "d_laz_compressed_bytes_overwritten.laz": "laz-damaged",
    "d_laz_cut_in_half.laz": "laz-damaged",
    "d_laz_unknown_compressor.laz": "laz-compressor",
    "d_not_las_text.las": "not-las",
    "d_offset_to_points_beyond_end.las": "las-header",
    "d_offset_to_points_inside_header.las": "las-header",
    "d_offset_x_inf.las": "las-header",
    "d_point_format_99.las": "las-header",
    "d_record_length_too_short.las": "las-header",
    "d_record_length_zero.las": "las-header",
    "d_scale_x_1e300.las": "las-header",
    "d_scale_x_nan.las": "las-header",
    "d_scale_x_zero.las": "las-header",
    "d_truncated_header_100_bytes.las": "las-header",
    "found_claims_1065_has_0.las": "no-points",
    "found_old_compressor_no_chunk_table.laz": "laz-compressor",
}
NOTICES = {
    "d_claims_4294967295_evlrs.laz": (1000, {"extended-records-broken"}),
    "d_claims_4294967295_vlrs.las": (1065, {"records-broken"}),
    "d_copc_hierarchy_page_loops_to_itself.copc.laz": (1065, {"copc-index", "creation-date"}),
    "d_copc_negative_halfsize.copc.laz": (1065, {"copc-index", "creation-date"}),
    "d_copc_root_hierarchy_offset_huge.copc.laz": (1065, {"copc-index", "creation-date"}),
    "d_evlr_offset_beyond_end.las": (1000, {"extended-records-broken"}),
    "d_first_vlr_length_65535.las": (1000, {"records-broken"}),
    "d_first_vlr_length_zero.las": (1000, {"records-broken"}),
    "d_gps_times_nan_and_1e300.las": (1065, {"gps-time-impossible"}),
    "d_header_box_lies.las": (1065, {"header-box"}),
    "d_las12_claims_4294967295_points.las": (1065, {"points-missing"}),
    "d_las14_claims_1e12_points.las": (1000, {"legacy-count", "points-missing"}),
    "found_389_vlrs.las": (1, set()),
    "found_bad_geotiff_keys.las": (10, {"returns-differ"}),
    "found_bad_vlr_count.las": (10, {"records-broken", "creation-date"}),
    "found_clipped_last_point.las": (1064, {"points-missing", "returns-differ"}),
    "found_empty_geotiff_vlrs.las": (43, set()),
    "found_garbage_number_of_vlrs.las": (718, {"records-broken", "points-missing", "returns-differ"}),
    "found_gps_time_nan.las": (1, {"gps-times-bad"}),
    "found_spurious_box.las": (1065, {"header-box"}),
}


def read(paths: list[Path]) -> tuple[dict[str, dict[str, Any]], str]:
    """What came of each file, read in one process of limited memory, and what that process wrote to standard error."""
    script = Path(__file__).with_name("read_hostile.py")
    done = subprocess.run(
        [sys.executable, script, str(ADDRESS_SPACE), *paths],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    last = paths[min(len(answers), len(paths) - 1)].name
    assert done.returncode == 0, f"ended with {done.returncode} at {last}\n{done.stderr[-2000:]}"
    return {answer["name"]: answer for answer in answers}, done.stderr


@pytest.fixture(scope="module")
def outcomes(shared_data: Path) -> dict[str, dict[str, Any]]:
    """Of all hostile files; on standard error, where a decoder that panics would write, there is nothing."""
    folder = shared_data / "las" / "hostile"
    survey(open_cloud(folder / "found_389_vlrs.las"))  # compiles what is not in the cache: that takes memory of its own
    found, said = read(sorted(folder.iterdir()))
    assert said == ""
    return found


def test_promise_08__all_files_end_by_themselves_in_time_and_memory(outcomes: dict[str, dict[str, Any]]) -> None:
    assert outcomes.keys() == ERRORS.keys() | NOTICES.keys()
    assert len(outcomes) == 46
    beyond = {
        name: (found["spent_s"], found["peak_kb"])
        for name, found in outcomes.items()
        if found["spent_s"] > SECONDS or found["peak_kb"] > PEAK_KB
    }
    assert beyond == {}


@pytest.mark.parametrize("name", ERRORS)
def test_promise_08__error_names_file_and_fault(outcomes: dict[str, dict[str, Any]], name: str) -> None:
    found = outcomes[name]
    assert found.get("error") == ERRORS[name]
    assert name in found["lines"][0]
    assert all(found["lines"])


@pytest.mark.parametrize("name", NOTICES)
def test_hostile__what_can_be_read_is_read_and_the_error_reported(
    outcomes: dict[str, dict[str, Any]], name: str
) -> None:
    points, codes = NOTICES[name]
    found = outcomes[name]
    assert (found.get("points"), set(found.get("notices", ["error"]))) == (points, codes), found
    assert all(name in text for text in found["texts"])


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("d_las12_claims_4294967295_points.las", ["4,294,967,295", "1,065"]),
        ("d_copc_negative_halfsize.copc.laz", ["-1"]),
        ("d_header_box_lies.las", ["1000000000", "635619.85"]),
        ("found_clipped_last_point.las", ["1,065", "1,064"]),
        ("found_spurious_box.las", ["-123.0749695", "-124.0687"]),
        ("d_gps_times_nan_and_1e300.las", ["1e+300"]),
    ],
)
def test_promise_08__both_figures_are_reported(outcomes: dict[str, dict[str, Any]], name: str, said: list[str]) -> None:
    text = " ".join(outcomes[name]["texts"])
    assert [figure for figure in said if figure not in text] == []


def test_damaged__whatever_changes_in_a_file_it_is_refused_or_read(shared_data: Path, tmp_path: Path) -> None:
    good = shared_data / "las" / "good"
    names = [
        "small_with_page.copc.laz",
        "las12_pf3_nocrs.laz",
        "las14_pf6_evlr.laz",
        "las14_pf7_wkt_compound_gpstime.las",
    ]
    chance = random.Random(15)
    paths = []
    for number in range(160):
        name = names[number % len(names)]
        data = bytearray((good / name).read_bytes())
        for _ in range(chance.choice([1, 2, 5])):
            reach = chance.choice([400, 3000, len(data)])
            at = chance.randrange(min(reach, len(data)) - 8)
            size = chance.choice([1, 4])
            data[at : at + size] = chance.choice([bytes(size), b"\xff" * size, chance.randbytes(size)])
        if chance.random() < 0.2:
            del data[chance.randrange(len(data)) :]
        paths.append(tmp_path / f"{number}_{name}")
        paths[-1].write_bytes(data)
    found, _ = read(paths)  # the decoder may panic (printed on standard error), which is an error like any other
    assert len(found) == len(paths)
    assert all(answer["spent_s"] <= SECONDS for answer in found.values())
    assert all(answer["points"] == answer["promised"] for answer in found.values() if "error" not in answer)
    assert 20 < sum("error" in answer for answer in found.values()) < 140
