"""Pages of a batch, of the ties of dates and of a field's history: local times, and in Japanese no English sentence."""

from __future__ import annotations

import html
import re
from typing import Any

import numpy as np
import shapely

from furrowmap.exporters.files.batch_state import Failure, SessionOutcome
from furrowmap.exporters.reports.season_pages import batch_page, history_page, tie_page
from furrowmap.exporters.vectors.batch_table import Row
from tests.exporters.reports.page_texts import shown, texts

JUNE = {
    "start": "2026-06-11T16:23:40.937Z",
    "start_local": "2026-06-12T01:23:40.937+09:00",
    "time_zone": "Asia/Tokyo",
}
LINES = (
    "north/session.toml: 'gone.pcap' does not exist.",
    "The session could not be opened.",
    "Correct the file name in the session file; paths are relative to that file.",
)
JAPANESE_LINES = (
    "north/session.toml：'gone.pcap' がありません。",
    "セッションを開けませんでした。",
    "セッションファイルのファイル名を直してください。パスはそのファイルからの相対パスです。",
)
MOVE = {
    name: 0.0123 for key in ("east_m", "north_m", "height_m", "tilt_east_deg", "tilt_north_deg", "turn_deg")
    for name in (key, f"{key}_sigma")
}  # fmt: skip
CHANGE = {
    "date_a": 1, "date_b": 2, "worked_m2": 28.8, "compared_m2": 26.4, "mean_change_m": 0.0246,
    "mean_change_sigma_m": 3e-4, "volume_m3": 0.707, "volume_sigma_m3": 0.008, "untouched_median_m": -0.0012,
}  # fmt: skip
WORK = {
    "worked_area_m2": 5421.3, "overlap_area_m2": 1.0, "missed_area_m2": None, "hours": 0.0072, "work_rate_ha_h": 0.38,
    "depth_m": 0.12, "soil_moved_m3": 0.7, "first_date": "2026-06-11", "last_date": "2026-06-18",
}  # fmt: skip


def batch() -> str:
    done = SessionOutcome(
        "", figures={**JUNE, "session": "北の畑", "duration_s": 59.8, "worked_area_m2": 42.5, "passes": 3}
    )
    failed = SessionOutcome("", failure=Failure("session-file-missing", LINES, 2, {"ja": JAPANESE_LINES}))
    return batch_page([Row("june", "", "東", done), Row("south", "", "", failed)])


def ties() -> str:
    dates: list[dict[str, Any]] = [
        {"date": k, "name": f"第{k}回", **JUNE, "tied": k < 3, **(MOVE if k < 3 else dict.fromkeys(MOVE))}
        for k in (1, 2, 3)
    ]
    tie = {"patches": 470, "upright": 12, "departures_m": 0.0024, "range_m": 8.0, "tension": 0.0, **MOVE}
    pairs = [{"date_a": 0, "date_b": 1, **tie}, {"date_a": 1, "date_b": 2, **tie}]
    return tie_page({"dates": dates, "ties": pairs, "changes": [CHANGE], "warnings": []})


def history() -> str:
    field = {"name": "北の畑", "area_m2": 12_000.0, "sessions": 2, **WORK}
    visit = {**WORK, "date": "2026-06-11", "name": "第1回", "machine": "トラクタ"}
    ground = np.array([shapely.box(0, 0, 5, 5)], object)
    return history_page(field, shapely.box(0, 0, 10, 10), [{**WORK, "season": 2026, "times_worked": 2,
                        "ground_m2": 56.4}], [visit], ground)  # fmt: skip


def test_pages__in_japanese_have_no_english() -> None:
    for page in (batch(), ties(), history()):
        said = [html.unescape(text).strip() for text in texts(shown(page, "ja"))]
        left = {text for text in said if re.search(r"[A-Za-z]{4}", re.sub("<data.*?</data>", "", text))}
        names = r"furrowmap [0-9.]+|north/session\.toml|session-file-missing|gone\.pcap|batch\.(csv|gpkg)"
        names += r"|tie\.json|june|south|\(Asia/Tokyo\)"
        assert not {text for text in left if re.search("[A-Za-z]{4}", re.sub(names, "", text))}


def test_pages__show_local_times_with_their_zone() -> None:
    for page in (batch(), ties()):
        assert "2026-06-12 01:23 (Asia/Tokyo)" in page
        assert "2026-06-11" not in page
    old = Row("old", "", "", SessionOutcome("", figures={"start": JUNE["start"]}))
    assert "2026-06-11 16:23 (UTC)" in batch_page([old])


def test_figures__are_as_large_as_their_units() -> None:
    page = shown(history())
    assert '<data class="area" value="5421.3">0.542 ha</data>' in page
    assert "<td>26 s</td>" in page  # of 0.0072 h
    assert "depth (approximate)" in page
    assert '<td class="text">トラクタ</td>' in page
