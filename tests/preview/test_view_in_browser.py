"""The page in a real browser: pictures, sliders, keys, narrow and wide, light and dark."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from printer_slicer.motion.rules import limits_of
from printer_slicer.preview import make_view_page, read_preview
from printer_slicer.profile import load_profile

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium-headless-shell", "chromium", "chromium-browser"))), None
)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NAME = '<img src=x onerror="document.title=1">tower.gcode'
HEIGHT_OF_TARGET = 44  # px


COLOURS = {"1": "role", "2": "speed", "3": "height"}
FOCUS = """() => {
    const one = document.activeElement;
    return [one.id || one.ariaLabel?.slice(0, 8) || one.textContent || one.value, getComputedStyle(one).outlineStyle];
}"""


def tower(layers: int) -> bytes:
    """A tower of two walls whose speed and width change with the height."""
    lines = ["G28", "M83"]
    for number in range(layers):
        z = 0.2 * (number + 1)
        lines += [";LAYER_CHANGE", ";HEIGHT:0.2", f"G1 Z{z:.2f} F600", ";TYPE:External perimeter"]
        lines += ["G1 X10 Y10 F9000", f"G1 X40 Y10 E{1 + number / 40} F{1200 + 60 * number}"]
        lines += ["G1 X40 Y40 E1", "G1 X10 Y40 E1", "G1 X10 Y10 E1", "G1 E-1 F2400"]
        lines += [";TYPE:Perimeter", "G1 X12 Y12 F9000", "G1 E1 F2400", "G1 X38 Y12 E0.9 F3000"]
        lines += ["G1 X38 Y38 E0.9", "G1 X12 Y38 E0.9", "G1 X12 Y12 E0.9"]
    return "\n".join(lines).encode()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium without a graphics processor."""
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Address of the page of a tower."""
    preview = read_preview(tower(20), NAME, limits_of(load_profile().printer))
    path: Path = tmp_path_factory.mktemp("view") / "tower.html"
    path.write_bytes(make_view_page(preview))
    return path.as_uri()


@pytest.fixture
def opened(browser: Browser, address: str, request: pytest.FixtureRequest) -> Iterator[Page]:
    """The page, opened; afterwards, it has made no errors and asked for nothing."""
    size, scheme = getattr(request, "param", ((1280, 800), "light"))
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    page = context.new_page()
    wrong: list[str] = []
    asked: list[str] = []
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda one: asked.append(one.url))
    page.goto(address)
    page.wait_for_selector("canvas", state="attached")
    wait(page)
    yield page
    assert wrong == []
    assert [one for one in asked if not one.startswith(("file:", "blob:"))] == []
    context.close()


def wait(page: Page) -> None:
    """Wait until what was asked is drawn."""
    page.evaluate(
        "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())))"
    )


def picture(page: Page) -> str:
    """What the visible canvas shows."""
    wait(page)
    data = page.evaluate("() => document.querySelector('canvas:not([hidden])').toDataURL()")
    return hashlib.sha256(data.encode()).hexdigest()


def press(page: Page, key: str) -> str:
    """The picture after a key."""
    page.keyboard.press(key)
    if key in COLOURS:
        page.wait_for_selector(f".stage[data-colours={COLOURS[key]}]")
    return picture(page)


SIZES = [
    ((360, 640), "light"),
    ((360, 640), "dark"),
    ((1280, 800), "light"),
    ((1280, 800), "dark"),
    ((3840, 2160), "light"),
]


@pytest.mark.parametrize("opened", SIZES, indirect=True)
def test_everything_fits_and_can_be_touched(opened: Page) -> None:
    assert opened.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert opened.title() == opened.inner_text("h1") == NAME
    small: list[Any] = opened.evaluate(
        """(least) => [...document.querySelectorAll("button, select, label.choice, input[type=range]")]
            .filter((one) => one.checkVisibility())
            .filter((one) => {
                const { height, right } = one.getBoundingClientRect();
                return height < least || right > innerWidth;
            })
            .map((one) => one.outerHTML)""",
        HEIGHT_OF_TARGET,
    )
    assert small == []
    unnamed = opened.evaluate(
        "() => [...document.querySelectorAll('input, select')].filter((one) => !one.labels.length).length"
    )
    assert unnamed == 0


@pytest.mark.parametrize("opened", SIZES[:4], indirect=True)
def test_sliders_and_boxes_change_the_picture(opened: Page) -> None:
    seen = [picture(opened)]
    for label, value in (("Moves", "7"), ("Layer", "3")):
        opened.get_by_label(label, exact=True).fill(value)
        seen.append(picture(opened))
    for label in ("Travels", "Retractions", "Seams"):
        opened.get_by_label(label).check()
        seen.append(picture(opened))
    for mode in ("speed", "width", "flow"):
        opened.get_by_label("Colours").select_option(mode)
        opened.wait_for_selector(f".stage[data-colours={mode}]")
        seen.append(picture(opened))
        assert opened.locator(".legend li").count() >= 4
    assert len(set(seen)) == len(seen)


@pytest.mark.parametrize("opened", [SIZES[0], SIZES[3]], indirect=True)
def test_keys_do_all_that_the_mouse_does(opened: Page) -> None:
    start = picture(opened)
    seen = [
        start,
        press(opened, "ArrowLeft"),
        press(opened, "Shift+ArrowUp"),
        press(opened, "+"),
        press(opened, "2"),
    ]
    assert len(set(seen)) == len(seen)
    press(opened, "0")
    press(opened, "1")
    press(opened, "Shift+ArrowDown")
    press(opened, "Shift+ArrowDown")
    assert opened.get_by_label("Layer", exact=True).input_value() == "0"
    # The focus goes through all controls in reading order, and is visible.
    reached: list[tuple[str, str]] = []
    for _ in range(9):
        opened.keyboard.press("Tab")
        reached.append(opened.evaluate(FOCUS))
    names = [name for name, _ in reached]
    wanted = ["Layer 1 ", "Zoom in", "Zoom out", "Show all", "layer", "layer", "moves", "Play", "mode"]
    assert names[: len(wanted)] == wanted
    assert {style for _, style in reached[: len(wanted)]} == {"solid"}


def test_hovering_tells_the_values_of_a_move(opened: Page) -> None:
    box = opened.locator("canvas").first.bounding_box()
    assert box is not None
    opened.keyboard.press("0")
    # The right side of the external perimeter: the print fills the height but for a border of 16 px.
    scale = (box["height"] - 32) / 30
    opened.mouse.move(box["x"] + box["width"] / 2 + 15 * scale, box["y"] + box["height"] / 2)
    told = opened.locator(".details").inner_text()
    assert told.startswith("External perimeter, X 40 Y 40 Z 2, width ")
    assert "height 0.2 mm" in told
    assert "tool 0" in told


def test_playing_shows_more_moves(opened: Page) -> None:
    opened.get_by_label("Moves", exact=True).fill("2")
    opened.get_by_role("button", name="Play").click()
    playwright.expect(opened.locator("#moves")).not_to_have_value("2")
    opened.get_by_role("button", name="Pause").click()
    playwright.expect(opened.get_by_role("button", name="Play")).to_be_visible()


@pytest.mark.parametrize("opened", [SIZES[0], SIZES[3]], indirect=True)
def test_all_layers_in_3d(opened: Page) -> None:
    opened.keyboard.press("v")
    opened.wait_for_selector("canvas[data-complete=true]")
    solid = opened.locator("canvas[data-complete]")
    all_moves = int(solid.get_attribute("data-moves") or "0")
    whole = picture(opened)
    opened.get_by_label("Lowest layer in 3D").fill("5")
    opened.wait_for_selector(f"canvas[data-complete=true]:not([data-moves='{all_moves}'])")
    assert picture(opened) != whole
    press(opened, "3")
    press(opened, "+")
    opened.wait_for_selector("canvas[data-complete=true]")


def test_light_and_dark_follow_the_system(opened: Page) -> None:
    light = opened.evaluate("getComputedStyle(document.body).backgroundColor")
    opened.get_by_label("Seams").check()
    before = picture(opened)
    opened.emulate_media(color_scheme="dark")
    assert opened.evaluate("getComputedStyle(document.body).backgroundColor") != light
    assert picture(opened) != before  # seams have the colour of texts
