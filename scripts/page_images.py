"""Makes the pictures of pages in the documentation anew: ``python scripts/page_images.py``.

Runs the sample recording tractor_fishtail and draws its report and its shared page with Chromium, on a desktop and on a
phone, and tractor_loop for form, dock and a printed page of QGIS. Run ``make demo`` before: the picture of its map is
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


def shoot_qgis(session: Path, result: Path, work: Path) -> None:
    """Form and result in the dock beside the map, and a printed page, in the desktop QGIS of the tests."""
    plugins = work / "plugins"
    shutil.copytree(CHECKOUT / "plugin", plugins / "furrowmap")
    own = CHECKOUT / "scripts"
    worker = subprocess.run([own / "qgis_worker.sh"], capture_output=True, text=True, check=True).stdout.strip()
    desktop = [own / "in_qgis_root.sh", "scripts/qgis_desktop.sh", str(plugins)]
    story = ["scripts/qgis_pictures.py", str(session), str(result), str(work)]
    environment = os.environ | {"QGIS_SIZE": "1180x760", "QGIS_INTERPRETER": worker}
    subprocess.run([*desktop, *story], cwd=CHECKOUT, env=environment, check=True)
    for name in ("dock", "preview", "session"):
        with Image.open(work / f"{name}.png") as drawn:
            picture = drawn.convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE)
            picture.save(IMAGES / f"qgis-{name}.png", optimize=True)
    with Image.open(work / "page.png") as drawn:
        drawn.convert("RGB").save(IMAGES / "qgis-page.jpg", quality=JPEG_QUALITY, optimize=True)


def main() -> None:
    """Write the pictures."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        drive = shutil.copytree(SAMPLES / "tractor_loop", work / "drive", copy_function=shutil.copyfile)
        session = drive / "session.toml"
        shoot_qgis(session, furrowmap.run(session, work / "loop").path, work)
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
