"""Batches whose recordings and results are in an object store, against moto's S3 server."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import fsspec
import pytest
from moto.server import ThreadedMotoServer

import furrowmap
from furrowmap.core.runtime.errors import InputError, UsageError
from furrowmap.exporters.files.batch_state import STATE
from furrowmap.workflows.batch.batch import run_job
from furrowmap.workflows.batch.jobs import Job
from furrowmap.workflows.batch.object_stores import MARKER, Store, earlier_in_store, is_url

ONE = furrowmap.BatchSettings(workers=1)


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """An empty bucket of a server in this process."""
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    fsspec.filesystem("s3", skip_instance_cache=True).mkdir("season")
    yield "s3://season"
    server.stop()


def test_batch__of_a_store_puts_whole_results_there(
    bucket: str, simulated: furrowmap.Simulated, tmp_path: Path
) -> None:
    files = {name: (simulated.folder / name).read_bytes() for name in ("session.toml", "recording.pcap", "gnss.nmea")}
    files["boundary.geojson"] = (simulated.folder / "boundary.geojson").read_bytes()
    for name, content in files.items():
        Store(f"{bucket}/in").write(f"north/{name}", content)
    Store(f"{bucket}/in").write("raw/recording.pcap", b"")
    found = furrowmap.batch([f"{bucket}/in"], f"{bucket}/out", ONE)
    assert (found.run, found.failed) == (("north",), ())
    assert [notice.code for notice in found.notices] == ["batch-no-session"]
    there = Store(f"{bucket}/out").files()
    assert {"batch.csv", "batch.gpkg", "batch.html", STATE, f"north/{MARKER}", "north/report.json"} <= there.keys()
    copy = tmp_path / "copy"
    Store(f"{bucket}/out/north").fetch([name.removeprefix("north/") for name in there if "north/" in name], copy)
    assert furrowmap.open_result(copy).report["figures"]["passes"] == 1

    again = furrowmap.batch([f"{bucket}/in"], f"{bucket}/out", ONE)
    assert (again.run, again.unchanged) == ((), ("north",))
    outcome = again.sessions[0].outcome  # without the state, what is done shows in the markers
    marked = earlier_in_store(f"{bucket}/out/north", outcome.key, outcome.inputs)
    assert marked == replace(outcome, repeated=True)
    assert earlier_in_store(f"{bucket}/out/north", "other settings", outcome.inputs) is None

    Store(f"{bucket}/in").write("north/session.toml", b"furrowmap = 1\n[recoding]\n")
    assert furrowmap.batch([f"{bucket}/in"], f"{bucket}/out", ONE).failed == ("north",)


def test_store__that_holds_nothing_or_cannot_be_opened_is_an_error(tmp_path: Path) -> None:
    assert is_url("sftp://host/season")
    assert not is_url(tmp_path)
    with pytest.raises(InputError) as empty:
        furrowmap.batch(["memory://nothing"], tmp_path / "results", ONE)
    assert empty.value.code == "batch-no-store"
    with pytest.raises(InputError) as outside:
        Store("memory://nothing").fetch(["../x"], tmp_path)
    assert outside.value.code == "batch-file-name"
    with pytest.raises(InputError) as unknown:
        Store("gs://bucket").files()  # gcsfs is not installed
    assert unknown.value.code == "extra-missing"
    text = 'furrowmap = 1\n[recording]\nlidar = ["a"]\ngnss = ["b"]\n[crs]\nmap = "EPSG:6677"\n'
    url = "memory://nothing"
    gone = run_job(Job("n", f"{url}/session.toml", text, "", url=url, results_url="s3://no bucket/x"))
    assert gone.failure is not None
    assert gone.failure.code == "batch-store"


@pytest.mark.parametrize(
    "place",
    [
        "file:///etc", "local:///etc", "http://169.254.169.254/latest", "https://example.org", "ftp://example.org",
        "github://owner:repository@main", "simplecache::s3://bucket/x", "s3://bucket/x::file:///etc",
        "zip://x::http://127.0.0.1/a.zip", "reference://x", "data://x", "dask://x", "bad://x",
    ],
)  # fmt: skip
def test_promise_23__only_stores_are_opened(place: str, tmp_path: Path) -> None:
    for folders, results in (([place], tmp_path / "results"), ([tmp_path], place)):
        with pytest.raises(UsageError) as refused:
            furrowmap.batch(folders, results, ONE)
        assert refused.value.lines[0].startswith(place.partition(":")[0])
    assert list(tmp_path.iterdir()) == []


def test_promise_23__names_in_a_store_lead_to_no_other_address(tmp_path: Path) -> None:
    """fsspec takes what follows "::" in a path as an address: here that of a file of this machine."""
    (tmp_path / "session.toml").write_text("secret = 1")
    system = fsspec.filesystem("memory")
    bucket = "/chained"
    name = f"{bucket}/x::file://{tmp_path}/session.toml"
    system.makedirs(name.rpartition("/")[0], exist_ok=True)
    system.pipe_file(name, b"furrowmap = 1")
    system.pipe_file(f"{bucket}/y/session.toml", b"furrowmap = 1")
    done = furrowmap.batch([f"memory:/{bucket}"], tmp_path / "results", ONE)
    told = {row.file: row.outcome.failure for row in done.sessions}
    assert len(told) == 2
    codes = {file.partition("/chained/")[2][:1]: failure.code for file, failure in told.items() if failure}
    assert codes["x"] == "usage"
    assert codes["y"] != "usage"
    assert "secret" not in repr(told)


def test_password__of_a_url_is_in_no_file_of_the_batch(tmp_path: Path) -> None:
    """A session that cannot run, from a store whose URL has a password, and results on the disk and in a store."""
    text = 'furrowmap = 1\n[recording]\nlidar = ["gone.pcap"]\ngnss = ["gone.nmea"]\n[crs]\nmap = "EPSG:6677"\n'
    place = "memory://me:S3cr3t@host"
    Store(f"{place}/in").write("north/session.toml", text.encode())
    local = furrowmap.batch([f"{place}/in"], tmp_path, ONE)
    assert local.failed == ("north",)
    assert local.sessions[0].file == "memory://me@host/in/north/session.toml"
    remote = furrowmap.batch([f"{place}/in/north"], f"{place}/out", ONE)
    assert remote.results == "memory://me@host/out"
    told = [line for row in (*local.sessions, *remote.sessions) for line in row.outcome.failure.lines]  # type: ignore[union-attr]
    assert not [line for line in told if "S3cr3t" in line]
    written = {path.name: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    there = Store(f"{place}/out")
    written |= {f"out/{name}": there.read(name) or b"" for name in there.files()}
    assert {"batch.csv", "batch.html", STATE, "out/batch.csv", f"out/{STATE}"} <= written.keys()
    assert [name for name, content in written.items() if b"S3cr3t" in content] == []
    with pytest.raises(InputError) as empty:
        furrowmap.batch(["memory://me:S3cr3t@host/empty"], tmp_path, ONE)
    assert "me@host" in str(empty.value)
    assert "S3cr3t" not in str(empty.value)
