"""A batch: every session once, failures told, nothing lost when workers or the batch itself end."""

from __future__ import annotations

import csv
import gzip
import html
import os
import shutil
import struct
import sys
from dataclasses import replace
from pathlib import Path
from time import monotonic

import geopandas as gpd
import numpy as np
import pytest
import shapely
from distributed import Client
from hypothesis import given
from hypothesis import strategies as st

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.pipeline.causes import DAMAGED, is_one_of
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice
from furrowmap.exporters.files.batch_state import STATE, batch_state
from furrowmap.workflows.batch import dask, workforce
from furrowmap.workflows.batch.batch import _lost
from furrowmap.workflows.batch.batch_sources import BatchSource, assign_names, find_sources, holds_scans
from furrowmap.workflows.batch.dask import DaskWorkers, _not_started, _unusable, cluster_of_scheduler, local_cluster
from furrowmap.workflows.batch.engine import Engine, OneProcess, WorkerDied
from furrowmap.workflows.batch.jobs import VISIT_MARGIN_S, Job, open_job, prepare, visits_of
from furrowmap.workflows.batch.workforce import Workforce
from tests.app.ending_workers import end_worker, variable

ONE = furrowmap.BatchSettings(workers=1)


@pytest.fixture
def season(simulated: furrowmap.Simulated, tmp_path: Path) -> Path:
    """A session, one that is broken, and recordings without a session."""
    folder = tmp_path / "season"
    for name in ("north/june", "raw"):
        (folder / name).mkdir(parents=True)
        for file in ("recording.pcap", "gnss.nmea"):
            shutil.copy(simulated.folder / file, folder / name)
    for file in ("session.toml", "boundary.geojson"):
        shutil.copy(simulated.folder / file, folder / "north" / "june")
    (folder / "south").mkdir()
    (folder / "south" / "session.toml").write_text("furrowmap = 1\n[recoding]\n")
    return folder


def first_half(capture: bytes) -> bytes:
    """The first packets of a capture, which a run takes half the time for."""
    end = 24
    while end < len(capture) // 2:
        end += 16 + struct.unpack_from("<I", capture, end + 8)[0]
    return capture[:end]


@pytest.mark.parametrize(("count", "shown", "more"), [(20, 20, ""), (22, 20, "  … 2 more")])
def test_dry_run__shows_the_first_names(
    simulated: furrowmap.Simulated,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    count: int,
    shown: int,
    more: str,
) -> None:
    for k in range(count):
        (tmp_path / "season" / f"day{k:02}").mkdir(parents=True)
        for file in simulated.folder.iterdir():
            (tmp_path / "season" / f"day{k:02}" / file.name).symlink_to(file)
    assert command_line(["batch", str(tmp_path / "season"), "-o", str(tmp_path / "out"), "--dry-run"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.strip() for line in lines if line.startswith("  day")] == [f"day{k:02}" for k in range(shown)]
    assert lines[-1] == (more or "  day19")
    assert not (tmp_path / "out").exists()


def test_batch__runs_each_session_once_and_tells_what_failed(
    season: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "results"
    planned = furrowmap.batch([season], results, ONE, dry_run=True)
    assert planned.run == ("north_june",)
    assert planned.estimate_s is not None
    assert planned.estimate_s > 0.0
    assert not results.exists()

    assert command_line(["batch", str(season), "-o", str(results), "--workers", "1"]) == 1
    said = capsys.readouterr()
    assert "unknown key `recoding`" in said.out
    assert "--machine" in said.err  # the recordings without a session
    assert furrowmap.open_result(results / "north_june").report["figures"]["passes"] == 1
    rows = {row["name"]: row for row in csv.DictReader((results / "batch.csv").open(encoding="utf-8"))}
    assert {name: (row["status"], row["code"]) for name, row in rows.items()} == {
        "north_june": ("done", ""),
        "south": ("failed", "session-unknown-key"),
    }
    report = furrowmap.open_result(results / "north_june")
    hull = gpd.read_file(results / "batch.gpkg", layer="sessions").to_crs(report.trajectory.crs)
    assert hull.buffer(0.02).covers(shapely.force_2d(report.coverage.union_all())).all()
    assert "north_june/report.html" in (results / "batch.html").read_text(encoding="utf-8")

    made = (results / "north_june" / "report.json").stat().st_mtime_ns
    again = furrowmap.batch([season], results, ONE)
    assert (again.run, again.unchanged, again.failed) == ((), ("north_june",), ("south",))

    os.utime(season / "north" / "june" / "gnss.nmea")  # another time, the same content
    looked = furrowmap.batch([season], results, ONE)
    assert looked.run == ("north_june",)
    assert [row.outcome.repeated for row in looked.sessions if row.outcome.failure is None] == [True]
    assert (results / "north_june" / "report.json").stat().st_mtime_ns == made

    (results / STATE).unlink()  # what is done shows in the results themselves, and who made them
    session = season / "north" / "june" / "session.toml"
    session.write_text(session.read_text().replace('name = "One pass"', 'name = "North"'))
    changed = furrowmap.batch([season], results, ONE)
    assert changed.run == ("north_june",)
    assert furrowmap.open_result(results / "north_june").report["session"]["name"] == "North"


def test_batch__names_damaged_inputs(
    simulated: furrowmap.Simulated, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Captures and logs that end early give results; the end of the output, the tables and the verdicts say so."""
    packets = first_half((simulated.folder / "recording.pcap").read_bytes())
    log = (simulated.folder / "gnss.nmea").read_bytes()
    zipped = gzip.compress(packets, 1)
    made = {
        "whole": (packets, log),
        "gzip": (zipped[: len(zipped) // 2], log),
        "checksum": (zipped[:-8] + bytes(8), log),
        "capture": (packets[: len(packets) // 2 + 1], log),
        "positions": (packets, log[: len(log) // 4]),
    }
    for name, (capture, positions) in made.items():
        folder = tmp_path / "season" / name
        folder.mkdir(parents=True)
        (folder / "recording.pcap").write_bytes(capture)
        (folder / "gnss.nmea").write_bytes(positions)
        for file in ("session.toml", "boundary.geojson"):
            shutil.copy(simulated.folder / file, folder)
    results = tmp_path / "results"
    assert command_line(["batch", str(tmp_path / "season"), "-o", str(results), "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert f"damaged inputs  {len(made) - 1}\n" in said
    page = (results / "batch.html").read_text(encoding="utf-8")
    rows = {row["name"]: row for row in csv.DictReader((results / "batch.csv").open(encoding="utf-8"))}
    for name in made:
        verdict = furrowmap.open_result(results / name).report["verdict"]
        damage = [one for one in verdict["findings"] if is_one_of(Notice.from_values(one["code"], {}), DAMAGED)]
        assert bool(rows[name]["damaged"]) == (f"\n{name}:\n" in said) == (name != "whole")
        if name == "positions":
            assert "covers only part of the recording" in rows[name]["damaged"]
            assert any("covers only part of the recording" in doubt for doubt in verdict["doubts"])
        else:
            assert bool(damage) == (name != "whole")
            assert all(html.escape(one["text"]) in page for one in damage)


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are Unicode elsewhere")
def test_batch__takes_names_that_are_no_unicode(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    """Of folders and of boundaries; what is kept of a batch is found again."""
    odd = os.fsdecode(b"caf\xe9")
    season, fields = tmp_path / "season", tmp_path / os.fsdecode(b"champs\xff")
    (season / odd).mkdir(parents=True)
    fields.mkdir()
    shutil.copy(simulated.folder / "boundary.geojson", fields / f"{odd}.geojson")
    shutil.copy(simulated.folder / "gnss.nmea", season / odd)
    (season / odd / "recording.pcap").write_bytes(first_half((simulated.folder / "recording.pcap").read_bytes()))
    text = (simulated.folder / "session.toml").read_text()
    (season / odd / "session.toml").write_text(text.replace('boundary = "boundary.geojson"', ""))
    settings = replace(ONE, boundaries=fields / f"{odd}.geojson")
    planned = furrowmap.batch([season], tmp_path / "results", settings, dry_run=True)
    assert len(planned.run) == 1
    done = furrowmap.batch([season], tmp_path / "results", settings)
    assert done.failed == ()
    assert furrowmap.batch([season], tmp_path / "results", settings).unchanged == done.run


def test_batch__of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as missing:
        furrowmap.batch([tmp_path / "there"], tmp_path / "results")
    assert missing.value.code == "batch-no-folder"
    with pytest.raises(InputError) as empty:
        furrowmap.batch([tmp_path], tmp_path / "results")
    assert empty.value.code == "batch-nothing"
    (tmp_path / "results" / STATE).write_bytes(b"no database" * 100)
    (tmp_path / "session.toml").write_text("furrowmap = 1\n")
    with pytest.raises(InputError) as damaged:
        furrowmap.batch([tmp_path], tmp_path / "results")
    assert damaged.value.code == "batch-state"


def test_recordings_of_a_machine__get_a_session_and_are_split_by_fields(shared_data: Path, tmp_path: Path) -> None:
    drive, home = shared_data / "tractor_loop", tmp_path / "card"
    home.mkdir()
    for name in ("gnss.nmea", "recording.pcap.gz"):
        shutil.copy(drive / name, home)
    furrowmap.save_machine(drive / "session.toml", tmp_path / "machine.toml")
    text = (tmp_path / "machine.toml").read_text(encoding="utf-8")
    (tmp_path / "machine.toml").write_text(
        text.replace("width_m", 'learned = "machine.npz"\nwidth_m'), encoding="utf-8"
    )
    (tmp_path / "machine.npz").touch()  # nothing is copied into the folder of the recordings
    outline = gpd.read_file(drive / "boundary.geojson").geometry[0]
    west, south, east, north = outline.bounds
    halves = [
        outline.intersection(shapely.box(west, south, (west + east) / 2, north)),
        shapely.box(10, 10, 10.01, 10.01),
    ]
    fields = tmp_path / "fields.gpkg"
    gpd.GeoDataFrame({"name": ["West", "Far"]}, geometry=halves, crs="EPSG:4326").to_file(fields)
    source = BatchSource(home / "session.toml", ("card",), made=True, stamps=())
    found = prepare(source, str(tmp_path / "machine.toml"), str(fields))
    assert found.failure is None
    assert sorted(path.name for path in home.iterdir()) == ["gnss.nmea", "recording.pcap.gz"]
    assert {visit.name.partition(" (")[0] for visit in found.visits} == {"West"}
    opened = open_job(
        Job(
            "card",
            str(home / "session.toml"),
            found.text,
            str(tmp_path),
            found.visits[0],
        )
    )
    assert opened.session.recording.span_s == found.visits[0].span_s
    assert opened.session.name == "card, West"
    assert opened.inputs.boundary is not None
    assert gpd.read_file(opened.inputs.boundary).geometry[0].equals_exact(halves[0], 1e-12)
    assert opened.session.antenna is not None


def test_visits__with_an_external_trajectory_are_those_of_its_poses(tmp_path: Path) -> None:
    """2 m/s east for 200 s, through a field that begins after 100 m and ends after 300 m."""
    head, t0_s = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg\n", 1_700_000_000
    rows = "".join(f"{t0_s + k},{16_650 + 2 * k},96560,271,0,0,90\n" for k in range(201))
    (tmp_path / "drive.csv").write_text(head + rows)
    (tmp_path / "recording.pcap").touch()
    session, fields = tmp_path / "session.toml", tmp_path / "fields.gpkg"
    session.write_text(
        'furrowmap = 1\n[recording]\nlidar = ["recording.pcap"]\n[crs]\nmap = "EPSG:6677"\n'
        '[trajectory]\nfiles = ["drive.csv"]\ntime = "utc"\n'
    )
    outline = gpd.GeoDataFrame({"name": ["East"]}, geometry=[shapely.box(16_750, 96_500, 16_950, 96_600)], crs=6677)
    outline.to_crs(4326).to_file(fields)
    found = prepare(BatchSource(session, ("drive",), made=False, stamps=()), "", str(fields))
    assert found.failure is None
    (visit,) = found.visits
    assert visit.name == "East"
    assert np.array(visit.span_s) - t0_s == pytest.approx([50.0 - VISIT_MARGIN_S, 150.0 + VISIT_MARGIN_S], abs=2.0)


@given(st.lists(st.tuples(st.sampled_from([-1, 0, 1]), st.integers(1, 200)), min_size=1, max_size=8))
def test_visits__are_the_stretches_of_half_a_minute_and_more_in_a_field(stays: list[tuple[int, int]]) -> None:
    """Against a count in plain Python: fields are the squares around (0, 0) and (10, 0), outside is (5, 5)."""
    at = {-1: (5.0, 5.0), 0: (0.0, 0.0), 1: (10.0, 0.0)}
    where = [k for k, length in stays for _ in range(length)]
    t_s = np.arange(len(where), dtype=float)
    found = visits_of(t_s, np.array([at[k] for k in where]), [shapely.box(-1, -1, 1, 1), shapely.box(9, -1, 11, 1)])
    expected: list[list[int]] = []
    run: list[int] = []
    for second in [*(s for s, k in enumerate(where) if k >= 0), None]:
        if run and (second is None or where[second] != where[run[-1]]):
            if sum(s + 1 < len(where) for s in run) >= 30:
                if expected and where[expected[-1][0]] == where[run[0]]:
                    expected[-1] += run
                else:
                    expected.append(run)
            run = []
        if second is not None:
            run = [*run, second]
    assert found == [(where[each[0]], each[0], each[-1]) for each in expected]


def test_sources__leave_out_results_and_what_is_hidden(tmp_path: Path) -> None:
    for name in ("a/session.toml", "a/deep/more.pcap", "b/session.toml", "b/report.json", ".hidden/session.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    for name in ("out/c/session.toml", "bags/1/metadata.yaml", "bags/1/x.db3", "day/rec.PCAP.gz", "note/readme.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = find_sources([tmp_path, tmp_path / "a" / "session.toml"], tmp_path / "out")
    assert [(one.file.relative_to(tmp_path).as_posix(), one.made) for one in found] == [
        ("a/session.toml", False),
        ("bags/session.toml", True),
        ("day/session.toml", True),
    ]
    assert holds_scans(["x.mcap.zst"])
    assert not holds_scans(["gnss.nmea", "recording.txt.gz"])


@given(
    st.lists(st.tuples(st.text(max_size=20), st.lists(st.text(max_size=6), max_size=3)), unique_by=lambda one: one[0])
)
def test_names__are_unique_and_stay(sources: list[tuple[str, list[str]]]) -> None:
    names = assign_names(sources, {})
    assert len({name.casefold() for name in names.values()}) == len(sources)
    assert all("/" not in name and not name.startswith(".") for name in names.values())
    assert assign_names([*sources, ("another", ["x"])], names).items() >= names.items()


def work_through(engine: Engine, tmp_path: Path, **kills_of: int) -> dict[str, object]:
    items = []
    for name, kills in kills_of.items():
        (tmp_path / name).mkdir()
        items.append((name, (str(tmp_path / name), kills)))
    return dict(engine.each(end_worker, items, lambda: None))


def test_one_process__is_replaced_and_gives_up_on_what_ends_it(tmp_path: Path) -> None:
    found = work_through(OneProcess(), tmp_path, sound=0, killed=2, deadly=99)
    assert isinstance(found["deadly"], WorkerDied)
    assert isinstance(found["sound"], int)
    assert isinstance(found["killed"], int)
    assert len({os.getpid(), found["sound"], found["killed"]}) == 3


def test_lost_dask_worker__is_replaced_and_its_item_repeated_and_a_lost_scheduler_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    with local_cluster(1, said.append) as engine:
        found = work_through(engine, tmp_path, sound=0, killed=1)
        # Dask sets it for its workers, and furrowmap's own setting of malloc gives way to one of the user.
        (trim,) = engine.each(variable, [("trim", "MALLOC_TRIM_THRESHOLD_")], lambda: None)

        monkeypatch.setattr(dask, "RECONNECT_S", 0.1)
        clients, until_s = [engine.client], monotonic() + 20.0

        def connect() -> Client:
            if not clients:
                raise OSError("nobody listens")
            return clients.pop()

        def tick() -> None:
            assert monotonic() < until_s, "it waits for ever"

        left = DaskWorkers(connect)
        left.close()
        with pytest.raises(FurrowmapError) as lost:
            list(left.each(variable, [("home", "HOME")], tick))
    assert lost.value.code == "batch-scheduler-lost"
    assert trim == ("trim", None)
    assert said == ["1 workers"]
    assert isinstance(found["sound"], int)
    assert isinstance(found["killed"], int)


def test_workforce__without_dask_is_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workforce, "find_spec", lambda _: None)
    assert Workforce(None, None, print).workers == 1
    with pytest.raises(InputError) as refused:
        Workforce(2, None, print)
    assert refused.value.code == "extra-missing"


def test_scheduler__that_does_not_answer_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask, "_CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(FurrowmapError) as error, cluster_of_scheduler("tcp://127.0.0.1:9", print):
        pass
    assert error.value.code == "no-scheduler"
    assert _not_started(RuntimeError("x")).code == "batch-no-workers"
    assert _unusable(ValueError("x")).code == "batch-cluster"
    assert _lost("north").code == "worker-lost"


def test_state__keeps_what_it_was_given(tmp_path: Path) -> None:
    with batch_state(tmp_path / STATE) as state:
        state.keep_names({"a": "north"})
        state.keep_prepared("a", "key", b"found")
    with batch_state(tmp_path / STATE) as state:
        assert state.sources() == {"a": "north"}
        assert state.prepared("a", "key") == b"found"
        assert state.prepared("a", "other") is None
        assert state.outcomes() == {}
