"""Links in a circle, pipes among the files and files in the place of folders: what random sessions found."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from threading import Event, Timer

import numpy as np
import pytest

import furrowmap
from furrowmap import InputError
from furrowmap.cli.main import attempt
from furrowmap.core.implement.saved import load_implement, save_implement
from furrowmap.core.live.difference import LIVE_LOG, live_difference
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.spinning.scanner_model import AngleTable
from furrowmap.core.readers.text_table import read_table
from furrowmap.core.runtime.file_names import found_beside
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.values.session import EXAMPLES
from furrowmap.workflows.live.feeds import recorder_status
from tests.app.obstacles import OBSTACLES, obstacle
from tests.core.implement.test_tool_history import TILLER
from tests.core.readers.test_nmea import gga, write
from tests.exporters.farm.result_folders import field

SESSION = """furrowmap = 1
[recording]
gnss = ["gnss.nmea"]
[crs]
map = "EPSG:6677"
[implement]
width_m = 1.7
xy_m = [-1.6, 0.0]
states = ["states.csv"]
[field]
boundary = "circle.geojson"
"""


def circle(path: Path) -> Path:
    """A link that leads to itself."""
    path.symlink_to(path.name)
    return path


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_a_circle_of_links__is_no_file(tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text(SESSION)
    for name in ("gnss.nmea", "states.csv"):
        (tmp_path / name).write_text("")
    circle(tmp_path / "circle.geojson")
    with pytest.raises(InputError) as refused:
        open_session(tmp_path / "session.toml")
    assert refused.value.code == "session-path-outside"
    with pytest.raises(InputError) as refused:
        furrowmap.propose_session([tmp_path / "circle.geojson"], tmp_path / "other.toml")
    assert refused.value.code == "no-such-file"


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
@pytest.mark.parametrize(
    "line", [["run"], ["run", "--preview"], ["crs"], ["frames"], ["inspect"], ["init"], ["live", "--from"]]
)
def test_a_circle_of_links__as_an_argument_is_no_bug(line: list[str], tmp_path: Path) -> None:
    status, error = attempt([*line, str(circle(tmp_path / "circle.toml"))])
    assert status in (1, 3)
    assert error is None or (error.code != "fault" and "circle.toml" in error.what)


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
@pytest.mark.parametrize(
    "line",
    [
        "batch {folder} -o {folder}/results --boundaries {circle} --dry-run",
        "batch {folder} -o {folder}/results --machine {circle} --dry-run",
        "batch {folder} -o {circle}",
        "batch {circle} -o {folder}/results",
        "run {folder}/session.toml -o {circle}",
        "run --preview {folder}/session.toml -o {circle}",
        "run {folder}/session.toml --within {circle}",
        "run --preview {circle}/session.toml",
        "season {circle} -o {folder}/season",
        "season {folder} -o {circle}",
        "init {circle} -o {folder}/new.toml",
        "machine save {folder}/session.toml {circle}",
        "calibrate {circle}",
        "calibrate mount {circle} {circle}",
        "export {circle} --to csv -o {folder}/exported",
        "export {folder} --to stac -o {circle}",
        "share {circle}",
        "farm add {circle} {folder}",
        "farm add {folder}/farm.gpkg {circle}",
        "farm mosaic {folder}/farm.gpkg -o {circle}",
        "surface {circle} -o {folder}/surfaces",
        "cloud {circle} -o {folder}/clouds",
        "gnss evaluate {circle}",
    ],
)
def test_a_circle_of_links__wherever_a_path_is_given_is_no_bug(line: str, tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text(SESSION.replace('boundary = "circle.geojson"', ""))
    for name in ("gnss.nmea", "states.csv"):
        (tmp_path / name).write_text("")
    link = circle(tmp_path / "circle.link")
    status, error = attempt(line.format(folder=tmp_path, circle=link).split())
    assert status in (1, 2, 3, 4)
    assert error is None or error.code not in ("fault", "system")
    if line.startswith(("export {circle}", "share", "farm add {circle}")):  # which looks there first
        assert error is not None
        assert error.code == "circular-links"
        assert str(link) in error.what
    assert link.is_symlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
@pytest.mark.parametrize("name", ["treatments.csv", "treatments.xlsx", "images.csv", "parcels.geojson"])
def test_a_pipe_beside_a_recording__is_passed_over(name: str, tmp_path: Path) -> None:
    write(tmp_path, *(gga(f"08000{k}.00") for k in range(5)), name="gnss.nmea")
    os.mkfifo(tmp_path / name)
    proposed = furrowmap.propose_session([tmp_path / "gnss.nmea"])
    assert name not in proposed.path.read_text(encoding="utf-8")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
def test_a_pipe_as_a_table__is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(ValueError, match="it is no file"):
        read_table(tmp_path / "pipe.csv", ValueError)  # type: ignore[arg-type]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
@pytest.mark.parametrize("kind", OBSTACLES)
@pytest.mark.parametrize("name", ["implement_3.npz", "field.gpkg-wal", "report.json"])
def test_a_run__that_could_leave_what_is_no_product_is_refused_before_the_work(
    name: str, kind: str, tmp_path: Path
) -> None:
    (tmp_path / "session.toml").write_text(SESSION.replace('boundary = "circle.geojson"', ""))
    for each in ("gnss.nmea", "states.csv"):
        (tmp_path / each).write_text("")
    (tmp_path / "out").mkdir()
    with obstacle(tmp_path / "out" / name, kind) as unchanged:
        with pytest.raises(InputError) as refused:
            furrowmap.run(tmp_path / "session.toml", tmp_path / "out", overwrite=True)
        unchanged()
    is_plain = kind == "hard link"  # which is replaced
    assert is_plain or (refused.value.code == "output-no-file" and name in refused.value.what)


def test_a_file_in_the_place_of_results__is_named(tmp_path: Path) -> None:
    (tmp_path / "results").write_text("a file")
    (tmp_path / "session.toml").write_text(SESSION)
    with pytest.raises(InputError) as refused:
        furrowmap.batch([tmp_path], tmp_path / "results" / "below")
    assert refused.value.code == "output-unwritable"
    assert "results" in refused.value.what


@pytest.mark.parametrize("content", [b"\xff" + SESSION.encode(), b"\x89PNG\r\n\x1a\n\0"])
@pytest.mark.parametrize("boundaries", [False, True])
def test_a_batch__names_a_session_that_is_no_text(content: bytes, boundaries: bool, tmp_path: Path) -> None:
    (tmp_path / "field").mkdir()
    (tmp_path / "field" / "session.toml").write_bytes(content)
    fields = tmp_path / "fields.csv"
    fields.write_text("name,lon_deg,lat_deg\nA,139.0,35.5\nA,139.1,35.5\nA,139.1,35.6\n")
    settings = furrowmap.BatchSettings(workers=1, boundaries=fields if boundaries else None)
    found = furrowmap.batch([tmp_path / "field"], tmp_path / "results", settings)
    (row,) = found.sessions
    assert row.outcome.failure is not None
    assert row.outcome.failure.code == "session-unreadable"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
def test_files_that_nobody_named__are_files_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("channel,elevation,azimuth\n")
    folder = tmp_path / "session"
    folder.mkdir()
    os.mkfifo(folder / "pipe.csv")
    (folder / "device.csv").symlink_to("/dev/zero")
    (folder / "link.csv").symlink_to(tmp_path / "other.csv")
    (folder / "own.csv").write_text("a,b\n")
    assert found_beside(folder, "*.csv") == [folder / "own.csv"]
    assert AngleTable.beside([folder / "recording.pcap"]) is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
@pytest.mark.parametrize("linked", [False, True])
def test_what_live_showed__is_not_read_through_a_link_or_a_pipe(linked: bool, tmp_path: Path) -> None:
    (tmp_path / "session").mkdir()
    log = tmp_path / "session" / LIVE_LOG
    if linked:
        (tmp_path / "other").write_text('{"crs": "EPSG:6677"}\n{"t_s": 0, "e_m": 0}\n')
        log.symlink_to(tmp_path / "other")
    else:
        os.mkfifo(log)
    assert live_difference(log.parent, "EPSG:6677", field()[0], None) is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
def test_what_the_recorder_says__is_not_read_through_a_link_that_leads_out_or_a_pipe(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    folder.mkdir()
    status = folder / "status.json"
    os.mkfifo(status)
    assert recorder_status(folder) == {}
    (tmp_path / "other").write_text('{"state": "ended"}')
    status.unlink()
    status.symlink_to(tmp_path / "other")
    assert recorder_status(folder) == {}
    (tmp_path / "other").rename(folder / "own")
    status.unlink()
    status.symlink_to("own")
    assert recorder_status(folder)["state"] == "ended"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
@pytest.mark.parametrize("device", ["/dev/zero", None])
def test_a_boundary__that_is_a_device_or_a_pipe_is_refused(device: str | None, tmp_path: Path) -> None:
    path = tmp_path / "boundary.geojson"
    path.symlink_to(device) if device else os.mkfifo(path)
    with pytest.raises(InputError, match="it is no file"):
        read_fields(path)


@pytest.mark.parametrize("key", [key for key in EXAMPLES if key.endswith(("minus_gnss_s", "delay_s"))])
@pytest.mark.parametrize("offset_s", [1e15, -1e300])
def test_an_offset__that_no_clocks_have_is_refused(key: str, offset_s: float) -> None:
    table, _, name = key.partition(".")
    needed = {"imu": 'files = ["imu.csv"]\n', "implement": "width_m = 1.7\nxy_m = [0.0, 0.0]\n"}.get(table, "")
    text = f"""furrowmap = 1\n[crs]\nmap = "EPSG:6677"\n[{table}]\n{needed}{name} = {offset_s}\n"""
    with pytest.raises(InputError) as refused:
        parse_session(text if table == "recording" else text + '[recording]\ngnss = ["gnss.nmea"]\n')
    assert name in refused.value.what
    assert "4000000000" in refused.value.what


def test_a_learned_implement__whose_images_do_not_fit_is_refused(tmp_path: Path) -> None:
    images = replace(TILLER.images, azimuth_deg=np.zeros(3))
    save_implement(tmp_path / "implement.npz", replace(TILLER, images=images))
    with pytest.raises(InputError) as refused:
        load_implement(tmp_path / "implement.npz")
    assert refused.value.code == "implement-unreadable"


def test_live__of_a_session_without_a_scanner_ends_when_it_is_stopped(tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text(SESSION.replace('boundary = "circle.geojson"', ""))
    for name in ("gnss.nmea", "states.csv"):
        (tmp_path / name).write_text("")
    stop = Event()
    Timer(0.5, stop.set).start()
    assert furrowmap.live(tmp_path, port=None, nmea_port=None, stop=stop).scans == 0
