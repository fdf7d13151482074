"""Writes plugin/locked_packages.txt: ``python scripts/plugin_lock.py``.

The list from which the plugin installs the dependencies of furrowmap: versions from ``constraints.txt``, with the
SHA-256 of the wheel that pip chooses on each platform with each version of Python. furrowmap itself is not among them.
Needs a package index, from which pip reads pages but no wheels. Platforms without a wheel of each package are left out
and reported.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

CHECKOUT = Path(__file__).resolve().parents[1]
LIST = CHECKOUT / "plugin" / "locked_packages.txt"
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
PLATFORMS = {  # (sys_platform, platform_machine) → pip's tags
    ("linux", "x86_64"): [*(f"manylinux_2_{minor}_x86_64" for minor in range(28, 16, -1)), "manylinux2014_x86_64"],
    ("linux", "aarch64"): [*(f"manylinux_2_{minor}_aarch64" for minor in range(28, 16, -1)), "manylinux2014_aarch64"],
    ("darwin", "arm64"): ["macosx_14_0_arm64"],
    ("darwin", "x86_64"): ["macosx_14_0_x86_64"],
    ("win32", "AMD64"): ["win_amd64"],
}
SYSTEMS = {"linux": "Linux", "darwin": "Darwin", "win32": "Windows"}
EXTRAS = ("bags",)
"""What the plugin installs besides: recordings in ROS bags are opened from its dock."""
MORE = ("pillow",)
"""Of other extras: with it, images of a camera colour points and give an orthophoto."""
Target = tuple[str, str, str]  # sys_platform, platform_machine, Python
HEAD = """\
# The dependencies of furrowmap, with the SHA-256 of their wheels: what the plugin installs into its environment.
# Written by scripts/plugin_lock.py. Complete for:
"""


def pinned() -> dict[str, str]:
    """Package → its version in ``constraints.txt``."""
    lines = (CHECKOUT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, version in pairs}


def needed(target: Target) -> set[str]:
    """Packages that furrowmap needs on a target with some extras, and those that build it from a checkout."""
    platform, machine, python = target
    environment = {
        "sys_platform": platform,
        "platform_system": SYSTEMS[platform],
        "os_name": "nt" if platform == "win32" else "posix",
        "platform_machine": machine,
        "python_version": python,
        "python_full_version": f"{python}.0",
        "platform_python_implementation": "CPython",
        "implementation_name": "cpython",
        "extra": "",
    }
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    waiting = [*project["project"]["dependencies"], *project["build-system"]["requires"]]
    waiting += [text for extra in EXTRAS for text in project["project"]["optional-dependencies"][extra]]
    waiting += MORE
    found: set[str] = set()
    while waiting:
        requirement = Requirement(waiting.pop())
        name = canonicalize_name(requirement.name)
        if name in found or (requirement.marker and not requirement.marker.evaluate(environment)):
            continue
        found.add(name)
        try:
            waiting += requires(name) or []
        except PackageNotFoundError:
            print(f"{name} ({platform}) is not installed here; its own dependencies are not looked at")
    return found


def hashes(target: Target, packages: set[str], versions: dict[str, str]) -> dict[str, str] | None:
    """Package → SHA-256 of the wheel that pip chooses; None where a package has none for the target."""
    platform, machine, python = target
    kept = {name: value for name, value in os.environ.items() if name == "PIP_CERT" or not name.startswith("PIP_")}
    environment = {**kept, "PIP_CONFIG_FILE": os.devnull}  # no wheels of this computer
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--no-deps", "--ignore-installed"]
        command += ["--only-binary=:all:", f"--python-version={python}", f"--target={folder}", f"--report={report}"]
        command += [f"--platform={tag}" for tag in PLATFORMS[platform, machine]]
        command += sorted(f"{name}=={versions[name]}" for name in packages)
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"left out: {' '.join(target)}: {done.stderr.strip().splitlines()[-1]}")
            return None
        chosen = json.loads(report.read_text(encoding="utf-8"))["install"]
    assert all(each["download_info"]["url"].startswith("https:") for each in chosen)
    return {
        canonicalize_name(each["metadata"]["name"]): each["download_info"]["archive_info"]["hashes"]["sha256"]
        for each in chosen
    }


def marker(targets: set[Target], everywhere: set[Target]) -> str:
    """The environment marker of a package that only these targets need.

    Raises:
        ValueError: if neither platforms alone nor versions of Python alone say which.
    """
    if targets == everywhere:
        return ""
    platforms, pythons = {target[0] for target in targets}, {target[2] for target in targets}
    if targets == {target for target in everywhere if target[0] in platforms}:
        return " ; " + " or ".join(f'sys_platform == "{platform}"' for platform in sorted(platforms))
    if targets == {target for target in everywhere if target[2] in pythons}:
        return " ; " + " or ".join(f'python_version == "{python}"' for python in sorted(pythons))
    raise ValueError(f"no marker for {sorted(targets)}")


def page() -> Iterator[str]:
    """The lines of the file."""
    versions = pinned()
    by_package: dict[str, dict[Target, str]] = defaultdict(dict)
    complete = set()
    for target in [(*platform, python) for platform in PLATFORMS for python in PYTHONS]:
        found = hashes(target, needed(target), versions)
        if found is not None:
            complete.add(target)
            for name, digest in found.items():
                by_package[name][target] = digest
    yield from HEAD.splitlines()
    for platform, machine in PLATFORMS:
        pythons = [python for python in PYTHONS if (platform, machine, python) in complete]
        if pythons:
            yield f"#   {platform} {machine}: Python {', '.join(pythons)}"
    for name, digests in sorted(by_package.items()):
        yield f"{name}=={versions[name]}{marker(set(digests), complete)} \\"
        yield " \\\n".join(f"    --hash=sha256:{digest}" for digest in sorted(set(digests.values())))


if __name__ == "__main__":
    LIST.write_text("\n".join([*page(), ""]), encoding="utf-8")
