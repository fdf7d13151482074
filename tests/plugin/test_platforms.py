"""The plugin's part that differs between platforms, each of them on this computer."""

from __future__ import annotations

import sys
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath

import pytest

from furrowmap.plugin.platforms import (
    listed_pythons,
    own_prefix,
    python_candidates,
    python_in,
    user_data,
    worker_environment,
)

QGIS = "C:/Program Files/QGIS 3.40"
LONG = {"C:\\PROGRA~1\\QGIS34~1.0": QGIS, "C:\\PROGRA~1\\QGIS34~1.0\\bin": f"{QGIS}/bin"}


def windows(folder: str) -> PureWindowsPath:
    """As Path.resolve() does on Windows: short names become long ones."""
    return PureWindowsPath(LONG.get(folder, folder))


def test_environment__on_windows_is_without_qgis(monkeypatch: pytest.MonkeyPatch) -> None:
    variables = {
        "Path": f"C:\\PROGRA~1\\QGIS34~1.0\\bin;{QGIS}\\apps\\Qt5\\bin;c:/program files/qgis 3.40/apps/qgis/bin;"
        "C:\\Windows\\system32;;D:\\圃場 tools",
        "PYTHONHOME": f"{QGIS}/apps/Python312",
        "PYTHONEXECUTABLE": f"{QGIS}/bin/python3.exe",
        "Gdal_Driver_Path": f"{QGIS}/apps/gdal/lib/gdalplugins",
        "OSGEO4W_ROOT": QGIS,
        "USERPROFILE": "C:\\Users\\畑 太郎",
    }
    for prefix in (QGIS, "C:\\PROGRA~1\\QGIS34~1.0"):
        assert worker_environment(variables, PureWindowsPath(prefix), "win32", windows) == {
            "Path": "C:\\Windows\\system32;D:\\圃場 tools",
            "OSGEO4W_ROOT": QGIS,
            "USERPROFILE": "C:\\Users\\畑 太郎",
            "PYTHONUTF8": "1",
            "PYTHONUNBUFFERED": "1",
        }


def test_environment__on_macos_is_without_the_bundle() -> None:
    variables = {
        "PATH": "/Applications/QGIS.app/Contents/MacOS/bin:/usr/bin:/bin",
        "DYLD_LIBRARY_PATH": "/Applications/QGIS.app/Contents/Frameworks",
        "__PYVENV_LAUNCHER__": "/Applications/QGIS.app/Contents/MacOS/QGIS",
        "HOME": "/Users/taro",
    }
    kept = worker_environment(variables, PurePosixPath("/Applications/QGIS.app"), "darwin", PurePosixPath)
    assert kept["PATH"] == "/usr/bin:/bin"
    assert kept["DYLD_LIBRARY_PATH"] == ""
    assert "__PYVENV_LAUNCHER__" not in kept


def test_environment__of_a_qgis_of_the_system_keeps_its_folders() -> None:
    variables = {"PATH": "/usr/bin:/usr/local/bin", "PROJ_LIB": "/usr/share/proj"}
    assert worker_environment(variables, None, "linux")["PATH"] == variables["PATH"]
    assert "PROJ_LIB" not in worker_environment(variables, None, "linux")


@pytest.mark.parametrize(
    ("application", "platform", "prefix"),
    [
        (PureWindowsPath("C:/Program Files/QGIS 3.40/apps/qgis"), "win32", "C:/Program Files/QGIS 3.40"),
        (PureWindowsPath("C:/OSGeo4W/apps/qgis-ltr"), "win32", "C:/OSGeo4W"),
        (PureWindowsPath("D:/QGIS"), "win32", "D:/QGIS"),
        (PurePosixPath("/Applications/QGIS-LTR.app/Contents/MacOS"), "darwin", "/Applications/QGIS-LTR.app"),
        (PurePosixPath("/opt/local"), "darwin", "/opt/local"),
        (PurePosixPath("/usr"), "linux", None),
        (PurePosixPath("/opt/qgis"), "linux", "/opt/qgis"),
    ],
)
def test_prefix__is_what_only_qgis_uses(application: PurePath, platform: str, prefix: str | None) -> None:
    found = own_prefix(application, platform)
    assert (found.as_posix() if found is not None else None) == prefix


def test_interpreter__of_an_environment(tmp_path: Path) -> None:
    assert python_in(tmp_path / "圃場 1", "win32") == tmp_path / "圃場 1" / "Scripts" / "python.exe"
    assert python_in(tmp_path, "darwin") == python_in(tmp_path, "linux") == tmp_path / "bin" / "python"


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")


def put(path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return str(path)


@pytest.mark.parametrize("desktop", ["C:/OSGeo4W/bin/qgis-bin.exe", "C:/OSGeo4W/apps/Python312/pythonw.exe"])
def test_base_python__on_windows_lies_in_qgis_s_python_folder(tmp_path: Path, nowhere: None, desktop: str) -> None:
    python = put(tmp_path / "apps" / "Python312" / "python.exe")
    assert python_candidates("win32", PureWindowsPath(desktop), tmp_path / "apps" / "Python312") == [python]
    console = PureWindowsPath("C:/OSGeo4W/bin/python3.exe")
    assert python_candidates("win32", console, tmp_path) == [str(console)]


def test_base_python__on_macos_is_found_beside_the_path_of_the_desktop(tmp_path: Path, nowhere: None) -> None:
    bundled = put(tmp_path / "QGIS.app" / "Contents" / "MacOS" / "bin" / "python3")
    framework = tmp_path / "Library" / "Frameworks" / "Python.framework" / "Versions"
    older, newer = (put(framework / version / "bin" / "python3") for version in ("3.9", "3.12"))
    brewed = put(tmp_path / "opt" / "homebrew" / "bin" / "python3")
    contents = tmp_path / "QGIS.app" / "Contents" / "MacOS"
    assert python_candidates("darwin", contents / "QGIS", contents, tmp_path) == [bundled, newer, older, brewed]


@pytest.mark.skipif(sys.platform == "win32", reason="programs have suffixes there")
def test_base_python__elsewhere_is_the_one_that_runs_or_is_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python = put(tmp_path / "python3")
    Path(python).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    for name, first in (("python3.12", ["/usr/bin/python3.12"]), ("qgis", [])):
        found = python_candidates("linux", PurePosixPath("/usr/bin") / name, Path("/nowhere"))
        assert found == [*first, python]


def test_launcher__lists_interpreters_with_spaces_in_their_paths() -> None:
    printed = (
        " -V:3.13 *        C:\\Users\\畑 太郎\\AppData\\Local\\Programs\\Python\\Python313\\python.exe\r\n"
        " -V:3.12          C:\\Program Files\\Python312\\python.exe\r\n"
        " -3.9-64          C:\\Python39\\python.exe\r\n"
        "No others\r\n"
    )
    assert listed_pythons(printed) == [
        "C:\\Users\\畑 太郎\\AppData\\Local\\Programs\\Python\\Python313\\python.exe",
        "C:\\Program Files\\Python312\\python.exe",
        "C:\\Python39\\python.exe",
    ]


def test_data_folder__of_each_platform(tmp_path: Path) -> None:
    roaming = {"APPDATA": str(tmp_path / "Roaming")}
    assert user_data("win32", roaming, tmp_path) == tmp_path / "Roaming"
    assert user_data("win32", {}, tmp_path) == tmp_path / "AppData" / "Roaming"
    assert user_data("darwin", {}, tmp_path) == tmp_path / "Library" / "Application Support"
    assert user_data("linux", {"XDG_DATA_HOME": "/data"}, tmp_path) == Path("/data")
    assert user_data("linux", {}, tmp_path) == tmp_path / ".local" / "share"
