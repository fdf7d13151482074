"""Makes the pictures of pages in the documentation anew: ``python scripts/page_images.py``.

Runs the sample recording tractor_fishtail and draws its report and its shared page with Chromium, on a desktop and on a
phone, and tractor_loop for the dock and a printed page of QGIS; ``make demo`` before it, and the picture of its map is
taken over.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from tools_of_tests import chromium

import furrowmap

CHECKOUT = Path(__file__).resolve().parents[1]
SAMPLES = CHECKOUT.parent / "shared" / "data"
IMAGES = CHECKOUT / "docs" / "images"
DEMO_MAP = CHECKOUT / "demo" / "result" / "map.png"
JPEG_QUALITY = 82
MAP_WIDTH = 1500


def shoot(page: Path, width: int, height: int, into: Path) -> Image.Image:
    """The picture of a page in a window of a size."""
    picture = into / f"{page.stem}-{width}.png"
    subprocess.run(
        [
            chromium(), "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            f"--user-data-dir={into / 'profile'}", "--virtual-time-budget=30000", f"--window-size={width},{height}",
            f"--screenshot={picture}", page.as_uri(),
        ],
        check=True,
        capture_output=True,
    )  # fmt: skip
    with Image.open(picture) as drawn:
        return drawn.convert("RGB")


def shoot_qgis(result: Path, work: Path) -> None:
    """The dock beside the map, and a printed page, in the desktop QGIS of the tests."""
    plugins = work / "plugins"
    shutil.copytree(CHECKOUT / "plugin", plugins / "furrowmap")
    script = "scripts/in_qgis_root.sh"
    command = [script, "scripts/qgis_desktop.sh", str(plugins), "scripts/qgis_pictures.py", str(result), str(work)]
    subprocess.run(command, cwd=CHECKOUT, env=os.environ | {"QGIS_SIZE": "1180x760"}, check=True)
    with Image.open(work / "dock.png") as drawn:
        drawn.convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE).save(IMAGES / "qgis-dock.png", optimize=True)
    with Image.open(work / "page.png") as drawn:
        drawn.convert("RGB").save(IMAGES / "qgis-page.jpg", quality=JPEG_QUALITY, optimize=True)


def main() -> None:
    """Write the pictures."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        shoot_qgis(furrowmap.run(SAMPLES / "tractor_loop" / "session.toml", work / "loop").path, work)
        result = furrowmap.run(SAMPLES / "tractor_fishtail" / "session.toml", work / "result")
        report = result.path / "report.html"
        shoot(report, 940, 1560, work).save(IMAGES / "report-page.png", optimize=True)
        shoot(report, 500, 1559, work).save(IMAGES / "report-page-phone.png", optimize=True)
        furrowmap.share(result.path, work / "page")
        shared = shoot(work / "page" / "index.html", 1200, 720, work)
        shared.save(IMAGES / "share-page.jpg", quality=JPEG_QUALITY, optimize=True)
    if DEMO_MAP.is_file():
        with Image.open(DEMO_MAP) as drawn:
            size = (MAP_WIDTH, round(drawn.height * MAP_WIDTH / drawn.width))
            drawn.convert("RGB").resize(size).save(IMAGES / "demo-map.jpg", quality=JPEG_QUALITY, optimize=True)
    else:
        sys.exit("There is no demo/result/map.png: run `make demo`, then this again, for demo-map.jpg.")


if __name__ == "__main__":
    main()
