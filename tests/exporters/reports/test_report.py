"""`report.json`: names, provenance, and JSON that every reader takes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.json_text import json_text, plain
from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.core.values.scan import Clock
from furrowmap.exporters.files.file_records import FileRecord, file_records
from furrowmap.exporters.reports.run_report import write_report

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)

TEXTS = ("text", *(f"text_{language}" for language in LANGUAGES[1:]))


def strict_json(text: str) -> Any:
    """What a reader makes of it that knows no NaN."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def test_report__has_its_versions_and_its_keys_in_order(tmp_path: Path) -> None:
    report = {
        "session_file": "../session.toml",
        "session": {"name": "圃場"},
        "inputs": [FileRecord("recording.pcap", 3, "ab")],
        "figures": {"points": np.int64(7_977_874), "spread_m": float("nan"), "box_m": np.array([1.0, 2.0])},
        "clocks": {"lidar": {"clock": Clock.SENSOR_GPS}},
        "warnings": [Notice("gap", text="A gap of 5 s.")],
    }
    path = tmp_path / "report.json"
    content = write_report(path, report)
    text = path.read_text(encoding="utf-8")
    assert strict_json(text) == content
    assert list(content) == ["furrowmap", "schema", *report]
    assert "圃場" in text
    assert content["schema"] == 1
    assert content["figures"] == {"points": 7_977_874, "spread_m": None, "box_m": [1.0, 2.0]}
    assert content["clocks"] == {"lidar": {"clock": "sensor-gps"}}
    (warning,) = content["warnings"]
    assert warning == {"code": "gap", "values": {"text": "A gap of 5 s."}, **dict.fromkeys(TEXTS, "A gap of 5 s.")}
    assert content["inputs"] == [{"name": "recording.pcap", "bytes": 3, "sha256": "ab"}]
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]


def test_file_records__agree_with_the_standards_test_vector(tmp_path: Path) -> None:
    # FIPS 180-4's example of one million times "a", and that of no byte at all (NIST, SHA-256 example vectors).
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / "a").write_bytes(b"a" * 1_000_000)
    (tmp_path / "empty").touch()
    shares: list[float] = []
    records = file_records(
        [tmp_path / "drive" / "a", tmp_path / "empty"], tmp_path, lambda _, share: shares.append(share)
    )
    assert records == [
        FileRecord("drive/a", 1_000_000, "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0"),
        FileRecord("empty", 0, "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"),
    ]
    assert shares[-1] == 1.0


def test_file_records__of_a_bags_folder_are_those_of_its_files(tmp_path: Path) -> None:
    (tmp_path / "bag" / "within").mkdir(parents=True)
    for name in ("metadata.yaml", "bag_0.db3"):
        (tmp_path / "bag" / name).write_text(name)
    names = [record.name for record in file_records([tmp_path / "bag"], tmp_path)]
    assert names == ["bag/bag_0.db3", "bag/metadata.yaml"]


@given(VALUES)
def test_json_text__is_what_it_was_given_with_null_for_what_is_not_finite(value: Any) -> None:
    def expected(item: Any) -> Any:
        if isinstance(item, float) and not math.isfinite(item):
            return None
        if isinstance(item, list):
            return [expected(i) for i in item]
        if isinstance(item, dict):
            return {key: expected(i) for key, i in item.items()}
        return item

    assert strict_json(json_text(value)) == expected(value)


def test_json_text__shows_the_odd_bytes_of_a_file_name() -> None:
    assert plain(Path("a\udcff.pcap")) == "a\\udcff.pcap"
    assert json_text({"\udcff": 1}).encode("utf-8") == b'{\n  "\\\\udcff": 1\n}\n'
