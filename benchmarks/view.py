"""Measure the page of `view`: its size, and in Chromium without a graphics processor memory, first picture and tasks.

    python benchmarks/view.py FILE.gcode [--rounds N]

A task is the time in which the page cannot answer. Chromium and playwright must be installed.
"""

from __future__ import annotations

import argparse
import gzip
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

from playwright.sync_api import Browser, sync_playwright
from processes import machine_note

from printer_slicer.motion.rules import limits_of
from printer_slicer.preview import encode_preview, make_view_page, read_preview
from printer_slicer.profile import load_profile

_BROWSERS: Final = ("chromium-headless-shell", "chromium", "chromium-browser")
_FLAGS: Final = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_WATCH: Final = """
    window.tasks = [];
    new PerformanceObserver((list) => {
        for (const one of list.getEntries()) window.tasks.push(one.duration);
    }).observe({ type: "longtask", buffered: true });
    new MutationObserver(() => {
        if (document.querySelector("canvas") && !window.first) {
            requestAnimationFrame(() => requestAnimationFrame(() => { window.first = performance.now(); }));
            window.first = -1;
        }
    }).observe(document, { childList: true, subtree: true });
"""
_FRAME: Final = "() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)))"


def main(argv: Sequence[str] | None = None) -> int:
    """Print one row per figure, the median of the rounds."""
    parser = argparse.ArgumentParser(description="Measure the page of `view` in Chromium.")
    parser.add_argument("gcode", type=Path)
    parser.add_argument("--rounds", type=int, default=3, help="how often the page is opened (default 3)")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        page = Path(folder) / "page.html"
        figures = _make_page(arguments.gcode, page)
        program = next(filter(None, map(shutil.which, _BROWSERS)))
        browser = driver.chromium.launch(executable_path=program, args=_FLAGS)
        rounds = [_measure(browser, page.as_uri()) for _ in range(arguments.rounds)]
        browser.close()
    for name in rounds[0]:
        figures[name] = median(one[name] for one in rounds)
    print(machine_note())
    for name, value in figures.items():
        print(f"{name:44}{value:12.4g}")
    return 0


def _make_page(gcode: Path, page: Path) -> dict[str, float]:
    """Write the page; return sizes and the times of the stages."""
    begin = time.process_time()
    preview = read_preview(gcode.read_bytes(), gcode.name, limits_of(load_profile().printer))
    read = time.process_time()
    written = make_view_page(preview)
    made = time.process_time()
    page.write_bytes(written)
    data = encode_preview(preview)
    return {
        "moves": preview.n_moves,
        "layers": preview.n_layers,
        "G-code, MB": gcode.stat().st_size / 1e6,
        "preview, MB": len(data) / 1e6,
        "preview, gzip, MB": len(gzip.compress(data, 9)) / 1e6,
        "page, MB": len(written) / 1e6,
        "reading, CPU s": read - begin,
        "writing, CPU s": made - read,
    }


def _measure(browser: Browser, address: str) -> dict[str, float]:
    """Open the page; return what it took."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.add_init_script(_WATCH)
    page.goto(address)
    page.wait_for_selector("canvas", state="attached", timeout=120_000)
    page.wait_for_timeout(500)
    figures = {"first picture, ms": page.evaluate("window.first")}
    figures["longest task until then, ms"] = _longest_task(page)
    figures |= _measure_heap(page)
    steps = []
    for _ in range(30):
        page.keyboard.press("ArrowUp")
        begin = time.perf_counter()
        page.evaluate(_FRAME)
        steps.append(1000 * (time.perf_counter() - begin))
    figures["next layer, ms, median"] = median(steps)
    figures["next layer, ms, worst"] = max(steps)
    page.evaluate("window.tasks.length = 0")
    for key in "23456":
        page.keyboard.press(key)
        page.evaluate(_FRAME)
    figures["longest task of layers and colours, ms"] = _longest_task(page)
    page.evaluate("window.tasks.length = 0")
    return figures | _measure_3d(page)


def _measure_3d(page: Any) -> dict[str, float]:
    """Show all layers in 3D; return how long the pictures take."""
    page.locator("#layer").focus()
    page.keyboard.press("End")
    begin = time.perf_counter()
    page.keyboard.press("v")
    page.wait_for_selector("canvas[data-complete]")
    page.evaluate(
        "() => { const gl = document.querySelector('canvas[data-complete]').getContext('webgl2'); gl.finish(); }"
    )
    coarse = time.perf_counter()
    moves = page.get_attribute("canvas[data-complete]", "data-moves")
    page.wait_for_selector("canvas[data-complete=true]", timeout=600_000)
    whole = time.perf_counter()
    figures = {
        "3D: moves of the coarse picture": float(moves),
        "3D: coarse picture, s": coarse - begin,
        "3D: every move, s": whole - begin,
        "3D: longest task, ms": _longest_task(page),
    }
    page.close()
    return figures


def _longest_task(page: Any) -> float:
    """Return the longest task so far, ms; 0 if none took 50 ms."""
    return float(page.evaluate("Math.max(0, ...window.tasks)"))


def _measure_heap(page: Any) -> dict[str, float]:
    """Return the memory of the page's JavaScript after a collection, MB."""
    session = page.context.new_cdp_session(page)
    before = session.send("Runtime.getHeapUsage")
    session.send("HeapProfiler.collectGarbage")
    after = session.send("Runtime.getHeapUsage")
    names = ("usedSize", "backingStorageSize")
    return {
        "heap and arrays before collection, MB": sum(before.get(name, 0) for name in names) / 1e6,
        "heap and arrays, MB": sum(after.get(name, 0) for name in names) / 1e6,
    }


if __name__ == "__main__":
    raise SystemExit(main())
