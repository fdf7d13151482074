"""A name read from a file is the name of one file in its folder, or it is refused."""

from __future__ import annotations

import os
import sys
from pathlib import Path, PureWindowsPath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import inside, is_file_name, is_portable_name, read_own

PARTS = st.sampled_from(
    [
        "..",
        ".",
        "/",
        "\\",
        "C:",
        "~",
        "etc",
        "dsm.tif",
        "\0",
        "\n",
        "\x1b[2J",
        "CON",
        "nul.txt",
        "圃場",
        " ",
        ":",
        "a" * 90,
    ]
)
HOSTILE = st.lists(PARTS, min_size=1, max_size=6).map("".join)
SOURCE = Path("report.json")


@given(name=HOSTILE | st.text(max_size=300))
def test_promise_23__name_that_is_taken_is_one_file_in_the_folder_on_every_system(name: str) -> None:
    if is_file_name(name):
        for kind, root in ((Path, "/data/result"), (PureWindowsPath, "D:\\result")):
            path = kind(root) / name
            assert path.parent == kind(root)
            assert path.name == name
        assert os.path.normpath(f"/data/result/{name}") == f"/data/result/{name}"
        # Python's own table of what Windows does not take, but for characters that only Windows forbids.
        assert name.isprintable() or not any(ord(c) < 32 for c in name)
        assert not PureWindowsPath(name).is_reserved()
        assert name[-1] not in ". "


@given(name=st.text(st.characters(categories=["L", "N"], include_characters="-_ ().,'%&圃"), min_size=1, max_size=60))
def test_usual_names__are_taken(name: str) -> None:
    whole = f"field {name}.geojson"
    assert is_file_name(whole)


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../x", "/etc/passwd", "a/b", "a\\b", "C:x", "c:\\x", "x\0.tif", "x\n", "nul", "COM1.tif",
     "lpt² .x", "dsm.tif.", "dsm.tif ", "é" * 128, "\ud800", "x\u2028y"],
)  # fmt: skip
def test_promise_23__such_names_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError) as raised:
        inside(tmp_path, name, SOURCE)
    assert raised.value.code == "name-outside"
    assert len(str(raised.value).splitlines()) == 3


@pytest.mark.skipif(os.name == "nt", reason="links need rights on Windows")
def test_promise_23__link_that_leads_out_is_refused_and_one_inside_taken(tmp_path: Path) -> None:
    folder = tmp_path / "result"
    folder.mkdir()
    (folder / "own").write_text("x")
    for name, target in {"in": "own", "out": "../other", "absolute": "/etc/passwd", "circle": "circle"}.items():
        (folder / name).symlink_to(target)
    assert inside(folder, "in", SOURCE) == folder / "in"
    for name in ("out", "absolute", "circle"):
        with pytest.raises(InputError):
            inside(folder, name, SOURCE)


@pytest.mark.parametrize("name", ["North field?", "3:4 m", 'the "low" one', "a|b", "<1>", "all*", "CON", "field."])
def test_new_names__are_such_that_windows_takes_them(name: str) -> None:
    assert not is_portable_name(name)
    assert is_portable_name("圃場 3 (north), 50 %")


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights on Windows")
def test_promise_23__a_file_of_a_folder_is_not_read_through_a_link_that_leads_out(tmp_path: Path) -> None:
    folder = tmp_path / "result"
    folder.mkdir()
    (tmp_path / "secret.json").write_bytes(b"secret")
    (folder / "own.json").write_bytes(b"own")
    (folder / "within.json").symlink_to("own.json")
    (folder / "out.json").symlink_to(tmp_path / "secret.json")
    (folder / "nowhere.json").symlink_to("gone.json")
    os.mkfifo(folder / "pipe.json")
    assert [read_own(folder, name) for name in ("own.json", "within.json")] == [b"own", b"own"]
    for name in ("out.json", "nowhere.json", "pipe.json", "missing.json"):
        with pytest.raises(OSError, match=r".") as refused:
            read_own(folder, name)
        assert name in str(refused.value)
