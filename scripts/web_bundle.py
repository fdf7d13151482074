"""Builds, once, the scripts of the page of `furrowmap share` (web/) with npm into exporters/share/bundle.

`python scripts/web_bundle.py` fails, saying why, where npm is missing or its registry cannot be reached. With
`--install` Node.js and npm are installed first, where they are missing, from Debian's packages. The versions of the
libraries are those of web/package-lock.json.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parent))
from installing import CHECKOUT, CannotInstallError, apt_install, digest, kept, locked

WEB = CHECKOUT / "web"
BUNDLE = CHECKOUT / "exporters" / "share" / "bundle"
SOURCES = [WEB / "package.json", WEB / "package-lock.json", *sorted(WEB.glob("*.js")), Path(__file__)]
# Any browser of the last years reads the scripts, from disk, too.
ESBUILD = ("--bundle", "--minify", "--format=iife", "--target=es2020", "--legal-comments=none", "--log-level=warning")
BUNDLES = {"map": (), "cloud": ("--global-name=furrowmapCloud",)}


def is_current() -> bool:
    """Whether the scripts are built, from the sources as they are."""
    stamp = BUNDLE / "stamp"
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == digest(SOURCES)


def build(*, install_npm: bool = False) -> None:
    """Build the scripts where they are not current, or copy them from the user's cache.

    Raises:
        CannotInstallError: if npm is missing, or cannot install the libraries.
    """
    stamp = digest(SOURCES)
    cached = kept(f"web-bundle-{stamp}")
    with locked(kept("web-bundle-lock")):
        if is_current():
            return
        if not (cached / "stamp").is_file():
            if install_npm and not shutil.which("npm"):
                apt_install("npm", "nodejs", "npm")
            with TemporaryDirectory() as scratch:
                built = bundle(Path(scratch))
                (built / "stamp").write_text(stamp, encoding="utf-8")
                shutil.rmtree(cached, ignore_errors=True)
                shutil.move(built, cached)
        shutil.rmtree(BUNDLE, ignore_errors=True)
        shutil.copytree(cached, BUNDLE)


def bundle(work: Path) -> Path:
    """The folder with the scripts and the licences of what is in them, made in an empty folder.

    Raises:
        CannotInstallError: if npm is missing, or one of its programs fails.
    """
    npm, node = shutil.which("npm"), shutil.which("node")  # on Windows npm.cmd
    if npm is None or node is None:
        raise CannotInstallError("npm is not installed")
    for path in SOURCES[:-1]:
        shutil.copy(path, work)
    run(work, npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--fetch-retries=1")
    out = work / "out"
    for name, options in BUNDLES.items():
        files = (f"--metafile={name}.json", f"--outfile=out/{name}.js")
        run(work, node, "node_modules/esbuild/bin/esbuild", f"{name}.js", *ESBUILD, *files, *options)
    (out / "licences.txt").write_text("".join(licence(work / name) for name in bundled(work)), encoding="utf-8")
    return out


def run(work: Path, *command: str) -> None:
    """Run a command there; its last line is the reason where it fails."""
    done = subprocess.run(command, cwd=work, capture_output=True, text=True, encoding="utf-8", check=False)
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise CannotInstallError(f"the libraries of the page cannot be installed: {reason}")


def bundled(work: Path) -> list[str]:
    """Folders of the packages of which something is in the scripts."""
    found = set()
    for name in BUNDLES:
        outputs = json.loads((work / f"{name}.json").read_text(encoding="utf-8"))["outputs"]
        for path, part in [item for output in outputs.values() for item in output["inputs"].items()]:
            top, *parts = path.split("/")
            if top == "node_modules" and part["bytesInOutput"]:
                found.add("/".join((top, *parts[: 1 + parts[0].startswith("@")])))
    return sorted(found)


def licence(package: Path) -> str:
    """Name, version, licence of a package and the licence's text."""
    about = json.loads((package / "package.json").read_text(encoding="utf-8"))
    texts = [path for path in sorted(package.iterdir()) if path.name.lower().startswith(("license", "licence"))]
    text = texts[0].read_text(encoding="utf-8") if texts else ""
    return f"{about['name']} {about['version']} ({about['license']})\n\n{text}\n\n"


if __name__ == "__main__":
    try:
        build(install_npm="--install" in sys.argv)
    except CannotInstallError as error:
        sys.exit(f"web_bundle.py: {error}")
