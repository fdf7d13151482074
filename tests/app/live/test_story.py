"""The page of a live session through a day: start, first pass, a second with overlap and miss, a gap, the end.

FURROWMAP_PICTURES=FOLDER keeps what it shows in each window, by day and at night.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from furrowmap.core.coverage.worked_cells import WorkedCells
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.exporters.work_colours import DAY, NIGHT
from furrowmap.workflows.live.live import by_language
from furrowmap.workflows.live.server import Hub, PageServer, Pictures, event

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

WINDOWS = ((360, 640), (768, 1024), (1280, 800))
PHONE = WINDOWS[:1]
WIDTH_M = 3.0
TARGET = 48
PARTS = "#alarm, #chips > *, #buttons button, #missing li, #scale, .guide, #eye, dl"
FIELD = [[[-6.0, -8.0], [60.0, -8.0], [60.0, 12.0], [-6.0, 12.0], [-6.0, -8.0]]]
HEADLAND = [[[0.0, -2.0], [54.0, -2.0], [54.0, 6.0], [0.0, 6.0], [0.0, -2.0]]]
ABOUT = {
    "origin_m": [0, 0],
    "background": None,
    "tool": {"xy_m": [-1.6, 0.0], "width_m": WIDTH_M},
    "field_m": FIELD,
    "headland_m": HEADLAND,
}
BOXES = """() => [...document.querySelectorAll(SELECTOR)]
  .filter((one) => one.offsetParent !== null)
  .map((one) => {
    const box = one.getBoundingClientRect();
    return [one.id || one.textContent, box.left, box.top, box.right, box.bottom, one.scrollWidth - one.clientWidth];
  })"""


ALARM = """([level, text]) => {
  const alarm = document.getElementById("alarm");
  if (alarm.hidden) return level === "";
  return alarm.dataset.level === level && document.getElementById("said").textContent.includes(text);
}"""


class Story:
    """A session that is told to the readers of a page."""

    def __init__(self) -> None:
        self.pictures = Pictures()
        self.hub = Hub(self.pictures.whole)
        self.cells = WorkedCells(WIDTH_M)
        self.t_s = 0.0

    def say(self, name: str, content: object) -> None:
        """Tell the readers, and those who join later."""
        message = event(name, content)
        self.pictures.remember(name, message)
        self.hub.publish(lambda: message)

    def place(self) -> None:
        """Where the map is."""
        self.hub.publish(lambda: self.pictures.placed(ABOUT))

    def drive(self, east_m: tuple[float, float], north_m: float, *, unseen: bool = False) -> None:
        """Work a pass."""
        steps = np.arange(east_m[0], east_m[1] + 0.1, 0.5)
        changed = set()
        for west, east in pairwise(steps):
            self.t_s += 0.5
            before, after = (np.array([[x, north_m - WIDTH_M / 2], [x, north_m + WIDTH_M / 2]]) for x in (west, east))
            changed |= self.cells.add_line(before, after, self.t_s, self.t_s, unseen=unseen)
            self.pictures.drive(float(east), north_m)
        changed |= self.cells.finish()
        self.hub.publish(lambda: self.pictures.changes(self.cells, changed))

    def pose(self, e_m: float, n_m: float, tool: str = "down", *, missing: tuple[str, ...] = (), **more: Any) -> None:
        """Where the vehicle is."""
        said = {"e_m": e_m, "n_m": n_m, "heading_deg": 90.0, "turn_degps": 0.0, "speed_mps": 0.0, "sigma_m": 0.012}
        said |= {"fix": "fixed", "position_age_s": 0.1, "delay_s": 0.12, "edge_m": [None, None]}
        self.say("pose", {"tool": tool, "missing": missing} | said | more)

    def figures(self, **more: Any) -> None:
        """Areas, and what is lost."""
        areas = [float(self.cells.area_m2(state)) for state in (1, 2, 3, 4)]
        said: dict[str, Any] = dict(zip(("worked_m2", "overlap_m2", "missed_m2", "not_seen_m2"), areas, strict=True))
        said |= {"left_m2": 1320.0 - areas[0], "rate_m2ps": 3.2, "waits_s": 0.0, "dropped": 0, "lost_packets": 0}
        self.say("figures", said | {"over": False, "warnings": []} | more)


@contextmanager
def shown(browser: Browser, language: str = "en") -> Iterator[tuple[Story, Page]]:
    """A story and the page that shows it."""
    story = Story()
    server = PageServer("127.0.0.1", 0, story.hub, language)
    page = browser.new_page(color_scheme="light")
    page.set_default_timeout(15_000)
    # Without a Japanese font the page would be in English: here its letters look different from each other.
    page.add_init_script("let looked = 0; HTMLCanvasElement.prototype.toDataURL = () => String(looked++);")
    faults = list[str]()
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(f"http://127.0.0.1:{server.server_address[1]}/")
    try:
        yield story, page
    finally:  # a page that stays open draws on, and takes a processor from the tests after it
        page.close()
        server.shutdown()
        server.server_close()
    assert faults == []


def boxes(page: Page, selector: str) -> dict[str, list[float]]:
    """Left, top, right, bottom and what does not fit, of what is visible, by its id or text."""
    found = page.evaluate(BOXES.replace("SELECTOR", f"'{selector}'"))
    return {str(name): [float(value) for value in rest] for name, *rest in found}


def assert_usable(page: Page) -> None:
    """Nothing lies on another, all figures fit, and gloves hit every button."""
    size = page.viewport_size
    assert size is not None
    buttons, parts = (
        boxes(page, "button"),
        boxes(page, "#alarm, #chips > *, #buttons button, #missing li, #scale, .guide, #eye, dl"),
    )
    assert {name: box for name, box in buttons.items() if min(box[2] - box[0], box[3] - box[1]) < TARGET} == {}
    for name, box in (buttons | parts).items():
        assert min(box[:2]) >= 0.0, name
        assert box[2] <= size["width"], name
        assert box[3] <= size["height"] + 0.5, name
    names = sorted(parts)
    for k, one in enumerate(names):
        for other in names[k + 1 :]:
            a = parts[one]
            b = parts[other]
            apart = a[2] <= b[0] + 1 or b[2] <= a[0] + 1 or a[3] <= b[1] + 1 or b[3] <= a[1] + 1
            assert apart, (one, a[:4], other, b[:4], size)
    assert {name: box for name, box in boxes(page, "dd").items() if box[4] > 0} == {}


def pixels(page: Page) -> NDArray[np.uint8]:
    """What is drawn on the map."""
    with Image.open(BytesIO(page.locator("#map").screenshot())) as image:
        return np.asarray(image.convert("RGB"))


def share_of(image: NDArray[np.uint8], colour: str) -> float:
    """The share of pixels that have a colour."""
    rgb = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)])
    return float((np.abs(image.astype(int) - rgb).max(axis=2) <= 2).mean())


def seen_everywhere(
    page: Page, name: str, windows: tuple[tuple[int, int], ...] = WINDOWS, *, mapped: bool = True
) -> dict[bool, NDArray[np.uint8]]:
    """Look at a moment in all windows, by day and at night; the maps of the widest, by whether at night.

    Without `mapped` there are no maps: each is a picture that the browser takes.
    """
    maps = dict[bool, NDArray[np.uint8]]()
    for night in (False, True):
        for width, height in windows:
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(30)
            assert_usable(page)
            if "FURROWMAP_PICTURES" in os.environ:
                light = "night" if night else "day"
                page.screenshot(path=Path(os.environ["FURROWMAP_PICTURES"]) / f"{name}-{width}-{light}.png")
        if mapped:
            maps[night] = pixels(page)
        page.click("#night")
    return maps


def alarm(page: Page, level: str, text: str = "") -> None:
    """Wait until the page has an alarm that is so loud and says that; none with an empty level."""
    page.wait_for_function(ALARM, arg=[level, text], timeout=15_000)


@pytest.mark.parametrize("language", LANGUAGES)
def test_page__tells_the_story_of_a_day(browser: Browser, language: str) -> None:
    with shown(browser, language) as (story, page):
        waits = InputError("live-waits")
        story.say("waiting", {one: waits.lines_in(one)[0] for one in LANGUAGES})
        page.wait_for_selector("#alarm[data-level=bad]")
        assert_usable(page)
        all_windows = "FURROWMAP_PICTURES" in os.environ
        windows = WINDOWS if language == "en" or all_windows else PHONE
        few = WINDOWS if all_windows else PHONE
        alarm(page, "bad", waits.lines_in(language)[0])
        seen_everywhere(page, f"1-start-{language}", PHONE, mapped=False)

        story.pictures.remember("waiting")
        story.place()
        story.say("pose", {"tool": "unknown", "missing": ["heading"], "antenna_m": [25.0, 0.0]})
        page.wait_for_selector("#missing li")
        spotted = seen_everywhere(page, f"1-antenna-{language}", PHONE)[False]
        assert share_of(spotted, DAY["vehicle"]) > 0.0005
        assert share_of(spotted, DAY["boundary"]) > 0.001
        story.drive((0.0, 40.0), 0.0)
        story.pose(25.0, 0.0, missing=("tool-learning",))
        story.figures()
        page.wait_for_selector("#tool[data-state=down]")
        alarm(page, "")
        assert page.inner_text("#worked").startswith("120")
        assert "37 m" in page.inner_text("#ahead")
        first = seen_everywhere(page, f"2-first-pass-{language}", few)
        for night, colours in ((False, DAY), (True, NIGHT)):
            assert share_of(first[night], colours["worked"]) > 0.02
            assert share_of(first[night], colours["tool-down"]) > 0.0003
            assert share_of(first[night], colours["boundary"]) > 0.0003
            assert share_of(first[night], colours["missed"]) == 0.0

        clock = Notice("record-clock", source="/dev/ttyACM0", off_s=412.0)
        warning = by_language({"code": clock.code, **clock.texts}) | {"code": clock.code}
        story.drive((0.0, 20.0), 2.5)
        story.drive((20.0, 40.0), 3.6)
        story.pose(23.0, 3.6, edge_m=[None, 0.6])
        story.figures(warnings=[warning])
        page.wait_for_selector("#edges:not([hidden])")
        alarm(page, "note", warning[language])
        second = seen_everywhere(page, f"3-second-pass-{language}", windows)
        assert share_of(second[False], DAY["overlap"]) > 0.002
        assert share_of(second[False], DAY["missed"]) > 0.002
        assert page.inner_text("#edge-right").startswith("60 cm")
        assert share_of(second[True], NIGHT["missed"]) > 0.002
        story.pose(24.0, 3.6, edge_m=[None, 0.6])
        page.click("#hide")
        alarm(page, "")

        for at_m in (10.0, 20.0):  # A and B; the tool is 0.4 m off the next parallel of their line
            story.pose(at_m, 0.0)
            page.wait_for_timeout(150)
            page.click("#bearing")
        story.pose(30.0, 3.4, "up", edge_m=[0.12, -0.2])
        page.wait_for_selector("#lightbar:not([hidden])")
        assert "40 cm ▶" in page.inner_text("#off-right")
        assert {"en": "not for steering", "de": "nicht zum Lenken", "ja": "操舵には使えません"}[
            language
        ] in page.inner_text("#eye")
        seen_everywhere(page, f"4-line-{language}", few, mapped=False)

        story.drive((10.0, 30.0), 7.0, unseen=True)
        lost: dict[str, Any] = {"missing": ("positions", "tool"), "position_age_s": 9.2, "speed_mps": 1.1}
        story.pose(30.0, 7.0, "unknown", **lost)
        story.figures()
        alarm(page, "bad", {"en": "No GNSS position for 10 s", "de": "Seit 10 s", "ja": "10 秒間"}[language])
        story.pose(30.0, 7.0, "unknown", **lost)
        story.figures(dropped=37, waits_s=12.0, warnings=[warning])
        alarm(
            page,
            "bad",
            {"en": "Scans are being dropped", "de": "Scans gehen verloren", "ja": "スキャンが欠落"}[language],
        )
        gap = seen_everywhere(page, f"5-gap-{language}", windows)
        assert share_of(gap[False], DAY["not-seen"]) > 0.002
        assert share_of(gap[True], NIGHT["not-seen"]) > 0.002
        assert page.inner_text("#unseen").startswith("60")
        assert page.inner_text("#dropped") == "37"
        assert page.locator("#cell-dropped.lost, #cell-unseen.lost").count() == 2

        story.figures(dropped=37, waits_s=9.0, over=True)
        alarm(page, "note", {"en": "being worked out", "de": "nachgerechnet", "ja": "計算しています"}[language])
        story.say("over", {})
        if language == LANGUAGES[0]:
            page.wait_for_timeout(2300)  # what is shown then is not called old
        alarm(
            page,
            "note",
            {"en": "The recording has ended.", "de": "Die Aufzeichnung ist beendet.", "ja": "記録は終わりました。"}[
                language
            ],
        )
        seen_everywhere(page, f"6-end-{language}", PHONE, mapped=False)
        page.reload()  # a reader that comes later sees the same
        page.wait_for_selector("#cell-dropped.lost")
        assert share_of(pixels(page), DAY["worked"]) > 0.01
        alarm(page, "note")
