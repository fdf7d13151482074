"""The list of packages that the plugin installs into its environment."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement

CHECKOUT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CHECKOUT / "scripts"))
from plugin_lock import LIST, PLATFORMS, PYTHONS, SYSTEMS, needed, pinned  # noqa: E402

TEXT = LIST.read_text(encoding="utf-8")
LOCKED = [Requirement(line.split(" \\")[0]) for line in TEXT.splitlines() if re.match(r"\w", line)]


def test_lock__names_no_furrowmap_and_no_address() -> None:
    assert "furrowmap" not in {requirement.name for requirement in LOCKED}
    assert "://" not in TEXT
    assert all(requirement.url is None for requirement in LOCKED)


def test_lock__has_a_checksum_for_each_package() -> None:
    blocks = TEXT.replace("\\\n", "").splitlines()
    packages = [block for block in blocks if re.match(r"\w", block)]
    assert len(packages) == len(LOCKED) > 20
    assert all(re.search(r"( +--hash=sha256:[0-9a-f]{64})+$", block) for block in packages)


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.parametrize("platform", sorted({platform for platform, _ in PLATFORMS}))
def test_lock__is_what_furrowmap_needs_in_the_versions_of_the_constraints(platform: str, python: str) -> None:
    """If it fails: python scripts/plugin_lock.py."""
    machine = next(machine for name, machine in PLATFORMS if name == platform)
    environment = {"sys_platform": platform, "platform_system": SYSTEMS[platform], "python_version": python}
    locked = {
        requirement.name: str(requirement.specifier).removeprefix("==")
        for requirement in LOCKED
        if requirement.marker is None or requirement.marker.evaluate(environment)
    }
    versions = pinned()
    assert locked == {name: versions[name] for name in needed((platform, machine, python))}
