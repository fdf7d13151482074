"""Packs the QGIS plugin: ``python scripts/plugin_zip.py [OUT.zip]``, by default ``dist/furrowmap-VERSION.zip``.

The zip holds one folder, ``furrowmap``, with the files of ``plugin/`` and ``metadata.txt``; the same checkout gives
the same bytes.
"""

from __future__ import annotations

import configparser
import sys
import zipfile
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
SUFFIXES = {".py", ".svg", ".png", ".qml", ".ts", ".html", ".css", ".ui", ".json", ".txt"}


def plugin_files() -> dict[str, Path]:
    """What goes into the zip: the name inside the folder → the file of the checkout."""
    plugin = CHECKOUT / "plugin"
    names = [p for p in sorted(plugin.rglob("*")) if p.suffix in SUFFIXES or p.name == "LICENSE"]
    return {"metadata.txt": CHECKOUT / "metadata.txt"} | {p.relative_to(plugin).as_posix(): p for p in names}


def version() -> str:
    """The plugin's version, as its metadata has it."""
    metadata = configparser.ConfigParser(interpolation=None)
    metadata.read(CHECKOUT / "metadata.txt", encoding="utf-8")
    return metadata["general"]["version"]


def pack(out: Path) -> None:
    """Write the zip."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, path in plugin_files().items():
            entry = zipfile.ZipInfo(f"furrowmap/{name}")
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, path.read_bytes())


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else CHECKOUT / "dist" / f"furrowmap-{version()}.zip"
    pack(target)
    print(target)
