"""The page is one file that needs nothing else and lets nothing else run."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import re
from html.parser import HTMLParser
from importlib.resources import files

import numpy as np
import pytest

from printer_slicer.javascript_modules import join_modules
from printer_slicer.preview import Preview, PreviewRole, decode_preview, encode_preview, make_view_page
from printer_slicer.preview.columns import NO_EXTRUSION_ROLES
from printer_slicer.preview.viewer_files import join_viewer_modules, read_viewer_file

HOSTILE = "</title><script>alert(1)</script><img src=x onerror=alert(1)>&\"'{{script}}\u202e.gcode"
MODULES = sorted(
    one.name
    for one in files("printer_slicer.preview").joinpath("viewer").iterdir()
    if one.name.endswith(".js")
)


class Elements(HTMLParser):
    """The elements of a page, their attributes and texts."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.found: list[tuple[str, dict[str, str | None], list[str]]] = []
        self.is_open = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs), []))
        self.is_open = True

    def handle_endtag(self, tag: str) -> None:
        self.is_open = False

    def handle_data(self, data: str) -> None:
        if self.is_open:
            self.found[-1][2].append(data)

    def text(self, tag: str, **wanted: str) -> str:
        (found,) = (
            "".join(text) for name, own, text in self.found if name == tag and wanted.items() <= own.items()
        )
        return found


def square(name: str) -> Preview:
    """A square of four walls on each of two layers."""
    corners = [(0, 0), (20, 0), (20, 20), (0, 20)]
    points = np.array([(0, 0, 0.2), *((x, y, z) for z in (0.2, 0.4) for x, y in (*corners[1:], corners[0]))])
    same = np.full(8, 0.4)
    return Preview(
        name=name,
        points=points,
        role=np.full(8, 4),
        width=same,
        height=same / 2,
        speed=100 * same,
        tool=np.zeros(8),
        roles=(*NO_EXTRUSION_ROLES, PreviewRole(name, "#e69f00", is_outer=True)),
        first=np.array([0, 4]),
        layer_z=np.array([0.2, 0.4]),
        layer_height=np.array([0.2, 0.2]),
        layer_seconds=np.ones(2),
        layer_command=np.array([0, 4]),
    )


def test_the_page_holds_the_preview() -> None:
    preview = square("part.gcode")
    page = Elements(make_view_page(preview).decode())
    data = gzip.decompress(base64.b64decode(page.text("script", id="preview")))
    assert data == encode_preview(preview)
    assert decode_preview(data).name == page.text("title") == "part.gcode"


def test_the_policy_allows_this_script_and_this_style_only() -> None:
    page = Elements(make_view_page(square("part")).decode())
    (policy,) = (
        own["content"] or "" for _, own, _ in page.found if own.get("http-equiv") == "Content-Security-Policy"
    )
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    for rule, text in (("script-src", page.text("script", type="module")), ("style-src", page.text("style"))):
        assert rules[rule] == f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
    assert set(rules) == {"default-src", "base-uri", "form-action", "script-src", "style-src"}


def test_the_page_names_no_other_address_and_has_no_inline_handlers() -> None:
    page = make_view_page(square("part")).decode()
    assert not re.search(
        r"(?:https?:)?//[a-z0-9]+\.|\burl\(|@import|await import|\beval\(|new Function|innerHTML", page
    )
    for _, own, _ in Elements(page).found:
        assert not [name for name in own if name.startswith("on") or name in ("src", "href", "style")]


@pytest.mark.parametrize("name", [HOSTILE, "", "\ud800", "a" * 300])
def test_hostile_names_stay_text(name: str) -> None:
    page = make_view_page(square(name)).decode()
    plain = make_view_page(square("part")).decode()
    assert [tag for tag, _, _ in Elements(page).found] == [tag for tag, _, _ in Elements(plain).found]
    assert html.unescape(Elements(page).text("title")) == name.encode("utf-8", "replace").decode()


def test_every_module_is_part_of_the_page() -> None:
    script = join_viewer_modules()
    assert "</script" not in script.lower()
    assert "<!--" not in script
    for name in MODULES:
        assert join_modules(read_viewer_file, name).split("\n")[-3] in script, name
        text = files("printer_slicer.preview").joinpath("viewer", name).read_text("utf-8")
        assert text.startswith("/**\n * "), name
        assert len(text.splitlines()) < 330, name
