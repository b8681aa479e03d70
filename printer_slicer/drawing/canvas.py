"""Pictures as lists of simple shapes, written as SVG text or as PNG with Pillow.

Positions are px from the upper left corner, x to the right, y downward. They refer to the edges of pixels, not to their
centres.
"""

from __future__ import annotations

import io
import re
import unicodedata
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from html import escape
from itertools import groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Float
from printer_slicer.errors import UsageError
from printer_slicer.saving import save
from printer_slicer.thumbnails import encode_image
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont
    from PIL.ImageFont import ImageFont as BitmapFont

__all__ = [
    "Box",
    "Fill",
    "Line",
    "Picture",
    "Raster",
    "Shape",
    "Strokes",
    "Text",
    "check_picture_path",
    "encode_picture",
    "estimate_text_width",
    "fit_text",
    "wrap_text",
]

Anchor = Literal["start", "middle", "end"]

_CONTROL_CHARACTERS: Final = re.compile("[^\x20-\x7e\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_FONT: Final = "Helvetica, Arial, 'Liberation Sans', sans-serif"
_SVG_SCALE: Final = 10  # SVG coordinates of areas are integers in tenths of a px
_PNG_SCALE: Final = 3  # PNGs are drawn this many times larger and then reduced, for smooth edges
_PIL_ANCHOR: Final = {"start": "ls", "middle": "ms", "end": "rs"}
_SUPERSCRIPTS: Final = {"²": "2", "³": "3"}
_SUPERSCRIPT_SIZE, _SUPERSCRIPT_RISE = 0.62, 0.36  # fractions of the size of the text


class Fill(Struct, frozen=True, eq=False):
    """An area of one colour.

    Attributes:
        rings: (n, 2) px each. Rings of the same orientation unite; holes have the opposite orientation.
        colour: "#rrggbb".
        name: class in the SVG, for programs that read the picture; may be empty.
    """

    rings: tuple[Float, ...]
    colour: str
    name: str = ""


class Line(Struct, frozen=True, eq=False):
    """A line through points (n, 2), px.

    Attributes:
        points: at least two.
        colour: "#rrggbb".
        width: px.
        dash: lengths of dash and gap, px; empty for a solid line.
        round: whether the ends are round; they extend the line by half its width.
        name: class in the SVG; may be empty.
    """

    points: Float
    colour: str
    width: float = 1.0
    dash: tuple[float, float] | tuple[()] = ()
    round: bool = False
    name: str = ""


class Box(Struct, frozen=True):
    """A rectangle with horizontal and vertical sides; `edge` is the colour of a thin outline, empty for none."""

    x: float
    y: float
    width: float
    height: float
    colour: str
    edge: str = ""
    name: str = ""


class Text(Struct, frozen=True):
    """One line of text; (x, y) is the start, middle or end of its baseline, see `anchor`."""

    x: float
    y: float
    text: str
    size: float
    colour: str = "#222222"
    anchor: Anchor = "start"
    bold: bool = False


class Strokes(Struct, frozen=True, eq=False):
    """Lines of one colour with round ends and corners.

    Attributes:
        lines: (n, 2) px each, at least two points.
        widths: width of each line, px.
        colour: "#rrggbb".
        name: class in the SVG; may be empty.
    """

    lines: tuple[Float, ...]
    widths: tuple[float, ...]
    colour: str
    name: str = ""


class Raster(Struct, frozen=True, eq=False):
    """An image of pixels (h, w, 4), RGBA from 0 to 255, that is scaled to `width` and `height` in px."""

    x: float
    y: float
    width: int
    height: int
    pixels: NDArray[np.uint8]


Shape = Fill | Line | Strokes | Box | Text | Raster
_EDGE_WIDTH: Final = 0.5


class Picture(Struct, frozen=True, eq=False):
    """Shapes on a white background; later shapes cover earlier ones.

    Attributes:
        width, height: px.
        shapes: the shapes.
        title: description for screen readers.
    """

    width: int
    height: int
    shapes: tuple[Shape, ...]
    title: str = ""

    def svg(self) -> str:
        """Return the picture as an SVG document that scales to its container."""
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" role="img" '
            f'font-family="{_FONT}">'
        )
        title = f"<title>{escape(_replace_control_characters(self.title))}</title>"
        back = f'<rect width="{self.width}" height="{self.height}" fill="#ffffff"/>'
        return "\n".join([head, title, back, *_format_svg_shapes(self.shapes), "</svg>"]) + "\n"

    def _repr_svg_(self) -> str:
        """Return the SVG for notebooks."""
        return self.svg()

    def __repr__(self) -> str:
        return f"<Picture {self.title!r}, {self.width} x {self.height} px>"

    def save(self, path: str | Path) -> None:
        """Write the picture to a .png or .svg file.

        Raises:
            UsageError: the name has another suffix.
            OutputError: the file cannot be written.
        """
        where = Path(path)
        save(where, encode_picture(self, where))

    def png(self) -> bytes:
        """Return the picture as a PNG file, one pixel per px.

        Letters missing in Pillow's built-in font are drawn without their accents, or as empty boxes.
        """
        from PIL import Image, ImageDraw  # noqa: PLC0415 - only PNGs need it

        image = Image.new("RGB", (self.width * _PNG_SCALE, self.height * _PNG_SCALE), "#ffffff")
        pen = ImageDraw.Draw(image)
        for shape in self.shapes:
            match shape:
                case Fill():
                    _paint_fill(image, pen, shape)
                case Line():
                    _paint_line(pen, shape)
                case Strokes():
                    for points, width in zip(shape.lines, shape.widths, strict=True):
                        _paint_line(pen, Line(points, shape.colour, width, round=True))
                case Box():
                    _paint_box(pen, shape)
                case Text():
                    _paint_text(pen, shape)
                case Raster():
                    _paint_raster(image, shape)
        stream = io.BytesIO()
        image.reduce(_PNG_SCALE).save(stream, "PNG")
        return stream.getvalue()


_BOLD_FACTOR: Final = 1.08
"""Width of bold letters divided by that of regular letters."""


def estimate_text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Estimate the width of a line of text in px, for the widest fonts that SVG viewers use."""
    n_wide = sum(unicodedata.east_asian_width(letter) in "WF" for letter in text)
    return size * (0.58 * (len(text) - n_wide) + 1.02 * n_wide) * (_BOLD_FACTOR if bold else 1)


def fit_text(text: str, size: float, max_width: float, *, bold: bool = False) -> str:
    """Shorten a line of text with an ellipsis until it is at most `max_width` px wide."""
    if estimate_text_width(text, size, bold=bold) <= max_width:
        return text
    while text and estimate_text_width(f"{text}…", size, bold=bold) > max_width:
        text = text[:-1]
    return f"{text.rstrip()}…"


def wrap_text(
    text: str, size: float, max_width: float, max_lines: int = 2, *, bold: bool = False
) -> list[str]:
    """Break a text at spaces into at most `max_lines` lines of at most `max_width` px; shorten the last one."""
    lines: list[str] = []
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and (len(lines) == max_lines or estimate_text_width(longer, size, bold=bold) <= max_width):
            lines[-1] = longer
        else:
            lines.append(word)
    return [fit_text(line, size, max_width, bold=bold) for line in lines]


def check_picture_path(path: Path) -> None:
    """Check that a file name ends in .svg or .png; `-` stands for SVG on stdout.

    Raises:
        UsageError: the name has another suffix.
    """
    if str(path) == "-" or path.suffix.lower() in {".svg", ".png"}:
        return
    if path.exists() and not (path.is_file() or path.is_dir()):  # a device or a pipe gets SVG
        return
    what = f"pictures in {path.suffix} format are not supported" if path.suffix else "the name has no suffix"
    raise UsageError(f"{path}: {what}", remedy="Use a name that ends in .svg or .png, or - for SVG on stdout")


def encode_picture(picture: Picture, path: Path) -> bytes:
    """Return the picture in the format of a file name: PNG for .png, SVG for .svg and `-`.

    Raises:
        UsageError: the name has another suffix.
    """
    check_picture_path(path)
    return picture.png() if path.suffix.lower() == ".png" else picture.svg().encode()


def _replace_control_characters(text: str) -> str:
    """Replace the control characters of a text, which XML does not allow."""
    return _CONTROL_CHARACTERS.sub("\N{REPLACEMENT CHARACTER}", text)


# SVG

_SVG_GROUPS: Final[Mapping[type, str]] = {
    Fill: "",
    Strokes: ' fill="none" stroke-linecap="round" stroke-linejoin="round"',
}


def _format_svg_shapes(shapes: Sequence[Shape]) -> Iterator[str]:
    """Yield one SVG element per shape; areas and strokes are grouped, with coordinates in tenths of a px."""
    for kind, several in groupby(shapes, type):
        style = _SVG_GROUPS.get(kind)
        if style is not None:
            yield f'<g transform="scale({1 / _SVG_SCALE:g})"{style}>'
        yield from map(_format_svg_shape, several)
        if style is not None:
            yield "</g>"


def _format_svg_shape(shape: Shape) -> str:
    """Return the SVG element of a shape."""
    match shape:
        case Fill():
            outline = "".join(map(_format_svg_ring, shape.rings))
            return f'<path{_format_svg_class(shape.name)} fill="{shape.colour}" d="{outline}"/>'
        case Line():
            return _format_svg_line(shape)
        case Strokes():
            return _format_svg_strokes(shape)
        case Box():
            edge = f' stroke="{shape.edge}" stroke-width="{_EDGE_WIDTH}"' if shape.edge else ""
            size = f'width="{shape.width:.2f}" height="{shape.height:.2f}"'
            place = f'x="{shape.x:.2f}" y="{shape.y:.2f}" {size}'
            return f'<rect{_format_svg_class(shape.name)} {place} fill="{shape.colour}"{edge}/>'
        case Raster():
            data = b64encode(encode_image(shape.pixels, "PNG")).decode("ascii")
            place = f'x="{shape.x:.2f}" y="{shape.y:.2f}" width="{shape.width}" height="{shape.height}"'
            return f'<image {place} href="data:image/png;base64,{data}"/>'
        case Text():
            place = f'x="{shape.x:.1f}" y="{shape.y:.1f}" font-size="{shape.size:g}"'
            anchor = f' text-anchor="{shape.anchor}"' if shape.anchor != "start" else ""
            bold = ' font-weight="bold"' if shape.bold else ""
            style = f'fill="{shape.colour}"{anchor}{bold}'
            return f"<text {place} {style}>{escape(_replace_control_characters(shape.text))}</text>"


def _format_svg_class(name: str) -> str:
    """Return the class attribute for a name; empty without a name."""
    return f' class="{name}"' if name else ""


def _format_svg_ring(ring: Float) -> str:
    """Return the SVG path of a closed outline in tenths of a px: its first point, then relative steps."""
    place = np.rint(ring * _SVG_SCALE).astype(np.int64)
    steps = np.diff(place, axis=0)
    steps = steps[steps.any(axis=1)]
    x, y = place[0].tolist()
    return f"M{x} {y}l{' '.join(map(str, steps.ravel().tolist()))}z" if len(steps) > 1 else ""


def _format_svg_strokes(strokes: Strokes) -> str:
    """Return one SVG path for each stroke width, with lengths in tenths of a px."""
    paths_by_width: dict[str, list[str]] = {}
    for points, width in zip(strokes.lines, strokes.widths, strict=True):
        place = np.rint(points * _SVG_SCALE).astype(np.int64)
        steps = np.diff(place, axis=0)
        steps = steps[steps.any(axis=1)] if len(steps) > 1 else steps
        x, y = place[0].tolist()
        path = f"M{x} {y}l{' '.join(map(str, steps.ravel().tolist() or [0, 0]))}"
        paths_by_width.setdefault(f"{width * _SVG_SCALE:.1f}".removesuffix(".0"), []).append(path)
    name = _format_svg_class(strokes.name)
    return "".join(
        f'<path{name} stroke="{strokes.colour}" stroke-width="{width}" d="{"".join(path)}"/>'
        for width, path in paths_by_width.items()
    )


def _format_svg_line(line: Line) -> str:
    """Return the SVG path of a line."""
    points = "L".join(f"{x:.2f} {y:.2f}" for x, y in line.points.tolist())
    dash = f' stroke-dasharray="{line.dash[0]:g} {line.dash[1]:g}"' if line.dash else ""
    ends = ' stroke-linecap="round" stroke-linejoin="round"' if line.round else ""
    stroke = f'stroke="{line.colour}" stroke-width="{line.width:.2f}"{ends}{dash}'
    return f'<path{_format_svg_class(line.name)} fill="none" d="M{points}" {stroke}/>'


# PNG


def _to_png_pixels(points: Float) -> Float:
    """Convert points from px to pixels of the enlarged PNG; Pillow's coordinates refer to the centres of pixels."""
    return points * _PNG_SCALE - 0.5


def _paint_fill(image: Image, pen: ImageDraw, fill: Fill) -> None:
    rings = [_to_png_pixels(ring) for ring in fill.rings if len(ring) > 2]
    sizes = [_compute_signed_area(ring) for ring in rings]
    if not any(size < 0 for size in sizes) or not any(size > 0 for size in sizes):
        for ring in rings:
            pen.polygon(ring.ravel().tolist(), fill=fill.colour)
        return
    _paint_with_holes(
        image, fill.colour, sorted(zip(rings, sizes, strict=True), key=lambda pair: -abs(pair[1]))
    )


def _paint_with_holes(image: Image, colour: str, rings: list[tuple[Float, float]]) -> None:
    """Paint rings through a mask, from the largest to the smallest; each ring is added to the mask or cut out of it."""
    from PIL import Image as images  # noqa: N813, PLC0415 - only PNGs need it
    from PIL import ImageDraw  # noqa: PLC0415

    corners = np.concatenate([ring for ring, _ in rings])
    low = np.maximum(np.floor(corners.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(corners.max(axis=0)) + 1, image.size).astype(int)
    if (high <= low).any():
        return
    mask = images.new("1", (int(high[0] - low[0]), int(high[1] - low[1])))
    pen = ImageDraw.Draw(mask)
    outward = rings[0][1] > 0
    for ring, size in rings:
        pen.polygon((ring - low).ravel().tolist(), fill=int((size > 0) == outward))
    image.paste(colour, (int(low[0]), int(low[1])), mask)


def _compute_signed_area(ring: Float) -> float:
    """Return the signed area of a ring, px²."""
    x, y = (ring - ring[0]).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _paint_line(pen: ImageDraw, line: Line) -> None:
    width = max(round(line.width * _PNG_SCALE), 1)
    for piece in _split_dashes(line.points, line.dash) if line.dash else [line.points]:
        places = _to_png_pixels(piece)
        pen.line(
            places.ravel().tolist(), fill=line.colour, width=width, joint="curve" if line.round else None
        )
        if line.round and width > 2:
            for x, y in (places[0].tolist(), places[-1].tolist()):
                reach = (width - 1) / 2
                pen.ellipse((x - reach, y - reach, x + reach, y + reach), fill=line.colour)


def _split_dashes(points: Float, dash: tuple[float, float]) -> Iterator[Float]:
    """Yield the dashes of a line; the pattern restarts on each straight piece."""
    stroke, gap = dash
    for a, b in pairwise(points):
        length = float(np.hypot(*(b - a)))
        for begin in np.arange(0.0, length, stroke + gap):
            end = min(begin + stroke, length)
            yield np.array([a + (b - a) * begin / length, a + (b - a) * end / length])


def _paint_box(pen: ImageDraw, box: Box) -> None:
    x0, y0 = round(box.x * _PNG_SCALE), round(box.y * _PNG_SCALE)
    x1 = max(round((box.x + box.width) * _PNG_SCALE) - 1, x0)
    y1 = max(round((box.y + box.height) * _PNG_SCALE) - 1, y0)
    pen.rectangle((x0, y0, x1, y1), fill=box.colour)
    if box.edge:
        pen.rectangle((x0, y0, x1, y1), outline=box.edge, width=max(round(_EDGE_WIDTH * _PNG_SCALE), 1))


def _paint_raster(image: Image, raster: Raster) -> None:
    from PIL import Image as Images  # noqa: PLC0415 - only PNGs need it

    size = raster.width * _PNG_SCALE, raster.height * _PNG_SCALE
    seen = Images.fromarray(raster.pixels).resize(size)
    image.paste(seen, (round(raster.x * _PNG_SCALE), round(raster.y * _PNG_SCALE)), seen)


def _paint_text(pen: ImageDraw, text: Text) -> None:
    """Paint text; superscripts are missing in Pillow's built-in font, so they are drawn small and raised."""
    pieces = [piece for piece in re.split("([²³])", _replace_control_characters(text.text)) if piece]
    fonts = [_load_font(text.size * (_SUPERSCRIPT_SIZE if piece in _SUPERSCRIPTS else 1)) for piece in pieces]
    shown = [_SUPERSCRIPTS.get(piece) or _strip_accents(piece) for piece in pieces]
    widths = [font.getlength(piece) for font, piece in zip(fonts, shown, strict=True)]
    x, y = text.x * _PNG_SCALE, text.y * _PNG_SCALE
    x -= sum(widths) * {"start": 0.0, "middle": 0.5, "end": 1.0}[text.anchor]
    # The font has one weight; bold letters get an outline in their own colour.
    stroke = text.size * _PNG_SCALE / 55 if text.bold else 0.0
    for piece, letters, font, width in zip(pieces, shown, fonts, widths, strict=True):
        up = text.size * _PNG_SCALE * _SUPERSCRIPT_RISE if piece in _SUPERSCRIPTS else 0.0
        pen.text((x, y - up), letters, text.colour, font, "ls", stroke_width=stroke)
        x += width


@cache
def _load_font(size: float) -> FreeTypeFont | BitmapFont:
    from PIL import ImageFont  # noqa: PLC0415 - only PNGs need it

    return ImageFont.load_default(size * _PNG_SCALE)


def _strip_accents(text: str) -> str:
    """Remove the accents of a text, which Pillow's built-in font lacks."""
    return "".join(
        letter for letter in unicodedata.normalize("NFKD", text) if not unicodedata.combining(letter)
    )
