"""The page in a real browser, with a real server and simulated printers."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from socket import socket
from threading import Thread
from typing import TYPE_CHECKING, Any, Literal

import pytest

import printer_slicer as ps
from printer_slicer.javascript_modules import join_modules
from tests.parts import box

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium-headless-shell", "chromium", "chromium-browser"))), None
)
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed"),
    pytest.mark.xdist_group("server page"),
]
PRINTERS = """
[narrow]
port = "sim:"
profile = "marlin_220"
speed = 20

[wide]
port = "sim:"
profile = "marlin_220"
speed = 20

[keyboard]
port = "sim:"
profile = "marlin_220"
speed = 20

[fast]
port = "sim:"
profile = "marlin_220"
speed = 30
"""
NAME = "<img src=x onerror=document.title=1>.gcode"
MODEL_NAME = "<img src=x onerror=document.title=1>.stl"
SAID = "<b onclick=document.title=1>hello"
HEIGHT_OF_TARGET = 44  # px
SIZES: list[tuple[tuple[int, int], Literal["light", "dark"]]] = [
    ((360, 640), "light"),
    ((360, 640), "dark"),
    ((1280, 800), "light"),
    ((1280, 800), "dark"),
]
SECTIONS = ("Printers", "New job", "Queue", "Files", "History", "Settings")

CONTRAST = """() => {
    const parse = (text) => text.match(/[\\d.]+/g).map(Number);
    const light = ([r, g, b]) => [r, g, b]
        .map((value) => value / 255)
        .map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4))
        .reduce((sum, value, index) => sum + value * [0.2126, 0.7152, 0.0722][index], 0);
    const findGround = (one) => {
        for (let parent = one; parent; parent = parent.parentElement) {
            const colour = parse(getComputedStyle(parent).backgroundColor);
            if (colour.length < 4 || colour[3] > 0) return colour;
        }
        return [255, 255, 255];
    };
    return [...document.querySelectorAll("body *")]
        .filter((one) => one.checkVisibility() && !one.closest(".unseen"))
        .filter((one) => [...one.childNodes].some((child) => child.nodeType === 3 && child.data.trim()))
        .map((one) => [one.textContent, light(parse(getComputedStyle(one).color)), light(findGround(one))])
        .filter(([, ink, ground]) => (Math.max(ink, ground) + 0.05) / (Math.min(ink, ground) + 0.05) < 4.5);
}"""
SMALL = """(least) => [...document.querySelectorAll("button, a, .button, select, summary, .choice, .field input")]
    .filter((one) => one.checkVisibility())
    .filter((one) => {
        const { height, width, right } = one.getBoundingClientRect();
        return height < least || width < least || right > innerWidth;
    })
    .map((one) => one.outerHTML)"""
UNNAMED = "() => [...document.querySelectorAll('input, select')].filter((one) => !one.labels.length).length"
WITHOUT_TEXT = """() => [...document.querySelectorAll("button, a, summary, img, canvas, progress, table")]
    .filter((one) => one.checkVisibility())
    .filter((one) => !(one.getAttribute("aria-label") ?? one.alt ?? one.textContent).trim())
    .map((one) => one.outerHTML)"""
HEADINGS = """() => [...document.querySelectorAll("h1, h2, h3")]
    .filter((one) => one.checkVisibility())
    .map((one) => Number(one.tagName[1]))"""
FOCUS = """() => {
    const one = document.activeElement;
    const shown = one.matches(".unseen") ? one.parentElement : one;
    const all = [...document.querySelectorAll("*")];
    return [all.indexOf(one), one.textContent, getComputedStyle(shown).outlineStyle];
}"""
DROP = """([content, name]) => {
    const data = new DataTransfer();
    data.items.add(new File([typeof content === "string" ? content : new Uint8Array(content)], name));
    document.querySelector(".drop").dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true }));
}"""


def make_gcode(said: str) -> str:
    """A print of two minutes on a real printer, which makes the printer say a text."""
    lines = ["G28", "M109 S200", f"M118 {said}"]
    for layer in range(20):
        lines += [";LAYER_CHANGE", f"G1 Z{0.2 * (layer + 1):.1f} F600"]
        lines += [f"G1 X{x} Y60 E0.1 F1200" for x in (60, 120, 60, 120, 60, 120)]
    return "\n".join([*lines, "M104 S0", ""])


class RunningServer:
    """A server in its own process.

    Attributes:
        link: signs in once.
        key: allows everything.
    """

    def __init__(self, folder: Path, printers: str = PRINTERS) -> None:
        (folder / "printers.toml").write_text(printers)
        self._folder = folder
        with socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"http://127.0.0.1:{free.getsockname()[1]}"
        self.key = re.findall(r"ps_\w{8}_[\w-]+", self._call("--new-key", "tests", "--scopes", "all"))[0]
        self.process, self.link = self.start()

    def start(self) -> tuple[subprocess.Popen[str], str]:
        """Start the server, and return its process and the link."""
        process = subprocess.Popen(
            [*self._command, "--listen", self.address.rsplit(":", 1)[1]],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=self._environment,
            text=True,
        )
        assert process.stdout is not None
        found = next(filter(None, (re.search(r"http\S+token=[\w-]+", line) for line in process.stdout)))
        return process, found[0]

    def stop(self) -> None:
        """End the server."""
        self.process.terminate()
        self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()

    @property
    def _command(self) -> list[str]:
        printers = str(self._folder / "printers.toml")
        return [sys.executable, "-m", "printer_slicer", "serve", "--printers-file", printers]

    @property
    def _environment(self) -> dict[str, str]:
        return {**os.environ, "PRINTER_SLICER_STATE": str(self._folder / "s"), "PYTHONUNBUFFERED": "1"}

    def _call(self, *options: str) -> str:
        return subprocess.run(
            [*self._command, *options], check=True, capture_output=True, text=True, env=self._environment
        ).stdout


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    server = RunningServer(tmp_path_factory.mktemp("page"))
    yield server
    server.stop()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def page(browser: Browser, running: RunningServer, request: pytest.FixtureRequest) -> Iterator[Page]:
    """The page, signed in with a key; afterwards, it has made no errors and asked no other host."""
    size, scheme = getattr(request, "param", None) or SIZES[2]
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    page = context.new_page()
    page.set_default_timeout(60_000)  # other programs may keep the machine busy
    wrong: list[str] = []
    asked: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda message: wrong.append(message.text))
    page.on("request", lambda one: asked.append(one.url))
    page.goto(running.address)
    page.get_by_label("Key", exact=True).fill(running.key)
    page.get_by_role("button", name="Sign in").click()
    page.get_by_role("heading", name="narrow").wait_for()
    yield page
    assert [one for one in wrong if "401" not in one and "ERR_CONNECTION" not in one] == []
    assert {one for one in asked if not one.startswith((running.address, "data:"))} == set()
    assert page.locator("img, b").count() == 0
    assert page.title() != "1"
    context.close()


def open_section(page: Page, name: str) -> None:
    page.get_by_role("link", name=name).click()
    page.get_by_role("heading", name=name, level=2).wait_for()


def check_page(page: Page) -> None:
    """Check that all fits, and can be read, touched and named."""
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert page.evaluate(SMALL, HEIGHT_OF_TARGET) == []
    assert page.evaluate(UNNAMED) == 0
    assert page.evaluate(WITHOUT_TEXT) == []
    assert page.evaluate(CONTRAST) == []
    levels = page.evaluate(HEADINGS)
    assert levels[0] == 1
    assert max(after - before for before, after in pairwise(levels)) <= 1
    assert page.evaluate("document.getAnimations().length") == 0


def tab_to(page: Page, wanted: Locator) -> None:
    """Wait until an element can be used, then press the tab key until it has the focus, which must be visible."""
    wanted.wait_for()
    page.wait_for_function("one => !one.disabled", arg=wanted.element_handle())
    for _ in range(80):
        page.keyboard.press("Tab")
        if wanted.evaluate("one => one === document.activeElement"):
            assert page.evaluate(FOCUS)[2] == "solid"
            return
    raise AssertionError(f"{wanted} cannot be reached")


def enter(page: Page, wanted: Locator) -> None:
    """Go to an element and press Enter."""
    tab_to(page, wanted)
    page.keyboard.press("Enter")


def make_model(folder: Path, name: str, size: tuple[float, float, float] = (10, 10, 3)) -> Path:
    """A box with a name, small if no size is given."""
    ps.export_stl(box(size), folder / name)
    return folder / name


TIME_LEFT = """
    const layers = { seconds: [10, 10, 10, 10], command: [0, 10, 20, 30] };
    const status = { state: "streaming", waits_for: "", total: 40, speed_percent: 100 };
    const follow = followProgress();
    return [
        follow({ ...status, done: 15, speed_percent: 50 }, layers, 1000),
        follow({ ...status, done: 25 }, layers, 1005),
        follow({ ...status, done: 25, state: "paused" }, layers, 1500),
        follow({ ...status, done: 40 }, layers, 1510),
    ];
"""
HAS_HEATED = """() => fetch("/v1/printers/fast/temperatures")
    .then((answer) => answer.json())
    .then((samples) => samples.some(({ temperatures }) => temperatures.T[1] > 150))"""
LOAD = """(address) => new Promise((resolve) => {
    const image = new Image();
    for (const kind of ["load", "error"]) image.addEventListener(kind, () => resolve(kind));
    image.src = address;
})"""
COLOURED = """one => {
    const copy = new OffscreenCanvas(one.width, one.height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(one, 0, 0);
    const { data } = copy.getImageData(0, 0, one.width, one.height);
    return data.filter((_, place) => place % 4 === 0)
        .filter((_, place) => data[4 * place + 3] > 0)
        .filter((red, place) => Math.max(red, data[4 * place + 1], data[4 * place + 2])
            - Math.min(red, data[4 * place + 1], data[4 * place + 2]) > 60).length;
}"""


@pytest.mark.parametrize(
    "page",
    [SIZES[0], SIZES[3], *(pytest.param(size, marks=pytest.mark.thorough) for size in SIZES[1:3])],
    indirect=True,
)
def test_a_model_is_sliced_and_printed_with_keys_alone(page: Page, tmp_path: Path) -> None:
    size = page.viewport_size
    assert size is not None
    model = make_model(tmp_path, f"box {size['width']} {MODEL_NAME}")
    enter(page, page.get_by_role("link", name="New job"))
    page.get_by_role("heading", name="New job").wait_for()
    with page.expect_file_chooser() as chooser:
        enter(page, page.locator(".drop input"))
    chooser.value.set_files(model)
    page.get_by_role("heading", name=model.name).wait_for()
    tab_to(page, page.get_by_role("combobox", name="Printer"))
    page.keyboard.type("fast")
    tab_to(page, page.get_by_role("combobox", name="Quality"))
    page.keyboard.type("draft")
    tab_to(page, page.get_by_role("spinbutton", name="Infill"))
    page.keyboard.type("20")
    check_page(page)
    enter(page, page.get_by_role("button", name="Compare layer plans"))
    page.get_by_role("table").wait_for()
    check_page(page)
    enter(page, page.get_by_role("button", name="Use uniform").last)
    page.get_by_role("status").filter(has_text="The layers are now uniform").wait_for()
    page.keyboard.press("Shift+Tab")
    while page.evaluate("document.activeElement.textContent") != "Slice":
        page.keyboard.press("Shift+Tab")
    page.keyboard.press("Enter")
    page.get_by_role("heading", name=f"{model.name} is sliced").wait_for()
    tab_to(page, page.get_by_role("slider"))
    page.get_by_text(re.compile(r"^Layer at .* high, \d+ of \d+$")).wait_for()
    page.keyboard.press("ArrowLeft")
    picture = page.get_by_role("img", name=re.compile("^Layer"))
    page.wait_for_function(f"one => ({COLOURED})(one) > 100", arg=picture.element_handle())
    page.keyboard.press("Home")
    page.get_by_text(re.compile(r"^Layer at 0\.\d+ mm, .* high, 1 of ")).wait_for()
    check_page(page)
    enter(page, page.get_by_role("button", name=re.compile("^Print ")))
    page.get_by_role("status").filter(has_text="is in the queue").wait_for()
    watch_print_with_keys(page, model.stem)


def watch_print_with_keys(page: Page, name: str) -> None:
    """Declare the bed clear, watch the print until its end, and find it in the history."""
    page.evaluate("document.activeElement.blur()")
    page.get_by_role("link", name="Printers").focus()
    page.keyboard.press("Enter")
    card = page.locator("li.card", has=page.get_by_role("heading", name="fast"))
    card.wait_for()
    enter(page, card.get_by_role("button", name="Bed is clear"))
    card.get_by_text(re.compile(r"^Layer \d+ of \d+ · .* left, ends \d\d:\d\d")).wait_for()
    card.get_by_text(name).first.wait_for()
    live = card.get_by_role("img", name=re.compile(r"^Layer at .* is printed$"))
    enter(page, card.locator("summary", has_text="Current layer"))
    live.wait_for()
    check_page(page)
    page.wait_for_function(f"one => ({COLOURED})(one) > 20", arg=live.element_handle())
    page.wait_for_function(HAS_HEATED)
    card.get_by_text("Not printing").wait_for(timeout=180_000)
    page.get_by_role("link", name="History").focus()
    page.keyboard.press("Enter")
    page.locator("li.card", has_text=name).get_by_text("done", exact=True).first.wait_for()


@pytest.mark.parametrize("page", [SIZES[0], SIZES[3]], indirect=True)
def test_a_dropped_model_is_sliced_queued_and_printed(page: Page, tmp_path: Path) -> None:
    size = page.viewport_size
    assert size is not None
    model = make_model(tmp_path, f"dropped {size['width']} {MODEL_NAME}")
    drop_model(page, model)
    page.get_by_role("combobox", name="Quality").select_option("draft")
    page.get_by_role("combobox", name="Printer").select_option("fast")
    page.get_by_role("button", name="Slice", exact=True).click()
    page.get_by_role("heading", name=f"{model.name} is sliced").wait_for()
    page.get_by_role("button", name=re.compile("^Print ")).click()
    page.get_by_role("status").filter(has_text="is in the queue").wait_for()
    watch_print_with_keys(page, model.stem)


def drop_model(page: Page, model: Path) -> None:
    """Drop a model on the section for new jobs."""
    open_section(page, "New job")
    page.evaluate(DROP, [list(model.read_bytes()), model.name])
    page.get_by_role("heading", name=model.name, exact=True).wait_for()


def test_a_model_is_shown_again_after_the_page_is_reloaded(page: Page, tmp_path: Path) -> None:
    model = make_model(tmp_path, f"reloaded {MODEL_NAME}", size=(60, 60, 40))
    drop_model(page, model)
    page.get_by_role("button", name="Slice", exact=True).click()
    progress = page.get_by_role("status").filter(has_text=f"{model.name}: ")
    progress.wait_for()
    page.reload()
    progress.wait_for()
    page.get_by_role("heading", name=f"{model.name} is sliced").wait_for()
    page.reload()
    page.get_by_role("heading", name=f"{model.name} is sliced").wait_for()
    page.get_by_role("button", name=re.compile("^Print ")).wait_for()
    drop_model(page, model)
    assert page.get_by_role("heading", name=f"{model.name} is sliced").count() == 0


def test_a_dropped_model_that_cannot_be_sliced_says_why(page: Page) -> None:
    open_section(page, "New job")
    page.evaluate(DROP, ["solid x", f"{MODEL_NAME}"])
    page.get_by_role("heading", name=MODEL_NAME).wait_for()
    page.get_by_role("button", name="Slice", exact=True).click()
    page.get_by_role("alert").filter(has_text=MODEL_NAME).wait_for()
    check_page(page)


def test_the_console_is_filtered(page: Page) -> None:
    open_section(page, "Files")
    page.evaluate(DROP, [make_gcode(f"{SAID} filter"), f"filter {NAME}"])
    row = page.locator("li.card", has_text="filter").first
    row.locator("summary").click()
    row.get_by_label("Printer").select_option("keyboard")
    row.get_by_role("button", name="Print").click()
    page.get_by_role("status").filter(has_text="is in the queue").wait_for()
    open_section(page, "Printers")
    card = page.locator("li.card", has=page.get_by_role("heading", name="keyboard"))
    card.get_by_role("button", name="Bed is clear").click()
    card.locator("summary", has_text="Console").click()
    lines = card.locator(".lines")
    lines.get_by_text(f"{SAID} filter").first.wait_for()
    card.get_by_label("Filter").fill("nothing has this")
    page.wait_for_function("one => one.children.length === 0", arg=lines.element_handle())
    card.get_by_label("Filter").fill("HELLO FILTER")
    lines.get_by_text(f"{SAID} filter").first.wait_for()
    cancel_print(card)


def test_a_model_under_files_is_not_uploaded(page: Page) -> None:
    open_section(page, "Files")
    page.evaluate(DROP, ["solid x", MODEL_NAME])
    page.get_by_role("alert").filter(has_text="is a model. Drop it under New job.").wait_for()


def test_the_time_left_follows_the_layers_and_the_pace(browser: Browser) -> None:
    folder = files("printer_slicer.server").joinpath("page")
    script = join_modules(lambda name: folder.joinpath(name).read_text("utf-8"), "print_progress.js")
    page = browser.new_page()
    found = page.evaluate(f"() => {{ {script} {TIME_LEFT} }}")
    page.close()
    assert found == [
        {"layer": 1, "share": 0.5, "secondsLeft": 50},  # at half the speed
        {"layer": 2, "share": 0.5, "secondsLeft": 7.5},  # two seconds of the print take one
        {"layer": 2, "share": 0.5, "secondsLeft": 15},  # the pause does not count
        {"layer": 3, "share": 1, "secondsLeft": 0},
    ]


def test_a_file_is_deleted_with_a_second_press(page: Page) -> None:
    open_section(page, "Files")
    page.evaluate(DROP, [make_gcode("delete"), f"delete {NAME}"])
    row = page.locator("li.card", has_text=f"delete {NAME}")
    row.get_by_role("button", name="Delete", exact=True).click()
    row.get_by_role("button", name="Press again").click()
    row.wait_for(state="detached")


def test_a_key_can_be_for_one_printer(page: Page) -> None:
    open_section(page, "Settings")
    page.get_by_label("Name of the new key").fill("one")
    page.get_by_role("combobox", name="Printer").select_option("wide")
    page.get_by_role("button", name="Create key").click()
    page.locator("li", has_text="only wide").wait_for()


def test_the_loaded_material_can_be_named(page: Page) -> None:
    card = page.locator("li.card", has=page.get_by_role("heading", name="wide"))
    card.locator("summary", has_text="PLA is loaded").click()
    card.get_by_role("combobox", name="Loaded material").select_option("petg")
    card.get_by_role("button", name="Set").click()
    card.locator("summary", has_text="PETG is loaded").wait_for()
    card.get_by_role("combobox", name="Loaded material").select_option("pla")
    card.get_by_role("button", name="Set").click()
    card.locator("summary", has_text="PLA is loaded").wait_for()


class _Camera(BaseHTTPRequestHandler):
    """Answers each request with a picture."""

    def do_GET(self) -> None:
        """Send the picture."""
        self.send_response(200)
        self.send_header("content-type", "image/svg+xml")
        self.end_headers()
        self.wfile.write(b"<svg xmlns='http://www.w3.org/2000/svg' width='64' height='48'/>")

    def log_message(self, *_: object) -> None:
        """Print nothing."""


def test_webcams_are_shown_and_other_hosts_are_not(browser: Browser, tmp_path: Path) -> None:
    with HTTPServer(("127.0.0.1", 0), _Camera) as camera:
        Thread(target=camera.serve_forever, daemon=True).start()
        own = f"http://127.0.0.1:{camera.server_port}/picture"
        server = RunningServer(tmp_path, f'[left]\nport = "sim:"\nprofile = "marlin_220"\nwebcam = "{own}"\n')
        context = browser.new_context()
        try:
            page = context.new_page()
            page.goto(server.link)
            page.locator("summary", has_text="Webcam").click()
            picture = page.locator("img[alt='Webcam of left']")
            page.wait_for_function("one => one.naturalWidth === 64", arg=picture.element_handle())
            page.locator("summary", has_text="Webcam").click()
            page.wait_for_function("one => !one.hasAttribute('src')", arg=picture.element_handle())
            other = own.replace("127.0.0.1", "localhost")
            assert page.evaluate(LOAD, own) == "load"
            assert page.evaluate(LOAD, other) == "error"
        finally:
            context.close()
            server.stop()
            camera.shutdown()


def test_the_link_signs_in_with_few_requests(browser: Browser, running: RunningServer) -> None:
    context = browser.new_context()
    page = context.new_page()
    asked: list[str] = []
    page.on("request", lambda one: asked.append(one.url))
    page.on("websocket", lambda one: asked.append(one.url))
    page.goto(running.link)
    page.get_by_role("heading", name="narrow").wait_for()
    page.wait_for_timeout(500)
    assert len(asked) <= 8, asked
    open_section(page, "Settings")
    page.get_by_role("button", name="Sign out").click()
    page.get_by_label("Key", exact=True).wait_for()
    page.goto(running.link)
    page.get_by_label("Key", exact=True).wait_for()
    context.close()


@pytest.mark.parametrize("page", SIZES, indirect=True)
@pytest.mark.parametrize("section", SECTIONS)
def test_everything_fits_and_can_be_read_and_touched(page: Page, section: str) -> None:
    open_section(page, section)
    page.wait_for_timeout(300)
    for summary in page.locator("summary").all():
        if summary.is_visible():
            summary.click()
    check_page(page)


def queue_file(page: Page, text: str, name: str, printer: str) -> None:
    """Drop a file, and queue a job for it."""
    open_section(page, "Files")
    page.evaluate(DROP, [text, name])
    row = page.locator("li.card", has_text=name).first
    row.locator("summary").click()
    row.get_by_label("Printer").select_option(printer)
    row.get_by_role("button", name="Print").click()


def cancel_print(card: Locator) -> None:
    """Cancel the print of a printer."""
    cancel = card.get_by_role("button", name=re.compile("^Cancel$|^Press again"))
    cancel.click()
    cancel.filter(has_text="Press again").click()
    card.get_by_text("Not printing").wait_for()


def list_requests_during_print(page: Page) -> list[str]:
    """Open the page a second time while one printer prints, and return what it asks for."""
    other = page.context.new_page()
    asked: list[str] = []
    other.on("request", lambda one: asked.append(one.url))
    other.on("websocket", lambda one: asked.append(one.url))
    other.goto(page.url.partition("#")[0])
    other.get_by_text(re.compile(r"^Layer \d+ of \d+ · .* left, ends \d\d:\d\d")).wait_for()
    other.close()
    return asked


@pytest.mark.parametrize(
    ("page", "printer"), [(SIZES[0], "narrow"), (SIZES[3], "wide")], indirect=["page"], ids=["360", "1280"]
)
def test_a_dropped_file_is_printed_once_the_bed_is_clear(page: Page, printer: str) -> None:
    name = f"{printer} {NAME}"
    queue_file(page, make_gcode(f"{SAID} {printer}"), name, printer)
    page.get_by_role("status").filter(has_text="is in the queue").wait_for()
    open_section(page, "Queue")
    job = page.locator("li.card", has_text=name)
    job.locator("summary").click()
    job.get_by_text(f"{printer}: its bed may be occupied").wait_for()

    open_section(page, "Printers")
    card = page.locator("li.card", has=page.get_by_role("heading", name=printer))
    card.get_by_role("button", name="Bed is clear").click()
    card.get_by_text(name).first.wait_for()
    card.get_by_text("printing", exact=True).wait_for()
    card.get_by_text(re.compile("^Layer [1-9]")).wait_for()
    assert len(list_requests_during_print(page)) <= 8
    assert card.get_by_label("Fan, %", exact=True).input_value() == "0"
    card.locator("summary", has_text="Console").click()
    card.locator(".lines").get_by_text(SAID).first.wait_for()
    card.get_by_label("Command").fill("speed 90")
    card.get_by_role("button", name="Send").click()
    card.get_by_text(re.compile("speed 90 %")).wait_for()
    assert page.get_by_role("button", name=f"Emergency stop: {printer}").is_visible()

    cancel_print(card)
    card.get_by_role("button", name="Bed is clear").wait_for()
    open_section(page, "History")
    page.locator("li.card", has_text=name).get_by_text("cancelled").first.wait_for()


@pytest.mark.parametrize("page", [SIZES[0]], indirect=True)
def test_a_rejected_job_can_be_printed_anyway(page: Page) -> None:
    name = "cold.gcode"
    queue_file(page, make_gcode("cold").replace("M109 S200\n", ""), name, "narrow")
    open_section(page, "Printers")
    card = page.locator("li.card", has=page.get_by_role("heading", name="narrow"))
    card.get_by_role("button", name="Bed is clear").click()
    open_section(page, "History")
    ended = page.locator("li.card", has_text=name).first
    ended.get_by_text("nothing was sent").wait_for()
    assert (
        not ended.get_by_role("button", name="again", exact=False).filter(has_text="Print again").is_visible()
    )
    ended.get_by_role("button", name="Print anyway").click()
    check_page(page)
    ended.get_by_role("button", name="Press again to print anyway").click()
    open_section(page, "Queue")
    waiting = page.locator("li.card", has_text=name)
    waiting.get_by_text("ready", exact=True).wait_for()
    open_section(page, "Printers")
    card.get_by_role("button", name="Bed is clear").click()
    card.get_by_text(name).first.wait_for()
    card.get_by_text("printing", exact=True).wait_for()
    cancel_print(card)


def test_keys_alone_reach_everything_in_reading_order(page: Page) -> None:
    seen = list[list[Any]]()
    page.evaluate("document.activeElement.blur()")
    for _ in range(8):
        page.keyboard.press("Tab")
        seen.append(page.evaluate(FOCUS))
    places = [place for place, _, _ in seen]
    assert places == sorted(places)
    assert [text for _, text, _ in seen[:6]] == list(SECTIONS)
    assert {outline for _, _, outline in seen} == {"solid"}
    assert seen[6][1] in {"Bed is clear", "Not clear"}
    card = page.locator("li.card", has=page.get_by_role("heading", name="keyboard"))
    while (
        page.evaluate("document.activeElement.closest('.card')?.querySelector('h3').textContent")
        != "keyboard"
    ):
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    card.get_by_role("button", name="Not clear").wait_for()
    page.get_by_role("link", name="Settings").focus()
    page.keyboard.press("Enter")
    page.get_by_role("heading", name="Settings").wait_for()
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.keyboard.press("d")
    page.wait_for_function("document.documentElement.dataset.scheme === 'dark'")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 24, 28)"


def test_a_key_is_shown_once_and_deleted_with_a_second_press(page: Page) -> None:
    open_section(page, "Settings")
    page.get_by_label("Name of the new key").fill(NAME)
    page.get_by_role("button", name="Create key").click()
    assert page.locator("code").inner_text().startswith("ps_")
    row = page.locator("li", has_text=NAME)
    row.get_by_role("button").click()
    row.get_by_role("button", name="Press again").click()
    row.wait_for(state="detached")
    page.reload()
    page.get_by_role("heading", name="Keys").wait_for()
    assert page.locator("code").count() == 0


def test_the_page_says_why_the_printers_cannot_be_read(browser: Browser, tmp_path: Path) -> None:
    server = RunningServer(tmp_path)
    (tmp_path / "printers.toml").write_text("[left\n")
    context = browser.new_context()
    try:
        page = context.new_page()
        page.goto(server.link)
        said = page.get_by_role("status").filter(has_text="printers.toml: line 1")
        said.wait_for()
        (tmp_path / "printers.toml").write_text(PRINTERS)
        page.get_by_role("heading", name="narrow").wait_for()
        said.wait_for(state="hidden")
    finally:
        context.close()
        server.stop()


def test_without_the_server_the_page_says_how_old_its_figures_are(page: Page, running: RunningServer) -> None:
    running.stop()
    page.get_by_text(re.compile(r"^Not connected\. Figures are from \d\d:\d\d\.$")).wait_for()
    running.process, running.link = running.start()
    page.locator(".connection").wait_for(state="hidden")
