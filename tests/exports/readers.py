"""Readers of contour files, written from the specifications alone; they share no code with the writers.

A layer is its z and its closed polylines; a polyline is its points as the file lists them, in mm.
"""

from __future__ import annotations

import re
import struct
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

import numpy as np

from printer_slicer.arrays import Float

SVG = "{http://www.w3.org/2000/svg}"
SLIC3R = "{http://slic3r.org/namespaces/slic3r}"


@dataclass
class CliFile:
    """A CLI file: what the header says, and (z, [(dir, points)]) of each layer command."""

    header: dict[str, str]
    comments: list[str]
    layers: list[tuple[float, list[tuple[int, Float]]]] = field(default_factory=list)

    @property
    def units(self) -> float:
        return float(self.header["UNITS"])


def read_cli(data: bytes) -> CliFile:
    """Either kind of CLI file: the header is text in both."""
    head, end, rest = data.partition(b"$$HEADEREND")
    assert end, "no end of the header"
    text = head.decode("ascii")
    comments = re.findall(r"//(.*?)//", text, re.DOTALL)
    commands = _commands(text)
    assert commands[0] == ("HEADERSTART", "")
    file = CliFile(dict(commands), comments)
    assert ("ASCII" in file.header) != ("BINARY" in file.header)
    if "ASCII" in file.header:
        _read_text(file, rest.decode("ascii"))
    else:
        _read_binary(file, rest, aligned="ALIGN" in file.header)
    assert int(file.header["LAYERS"]) == len(file.layers)
    return file


def _commands(text: str) -> list[tuple[str, str]]:
    """`$$NAME/parameters` in a text without its comments."""
    bare = re.sub(r"//.*?//", "", text, flags=re.DOTALL)
    found = []
    for piece in bare.split("$$")[1:]:
        name, _, parameters = piece.partition("/")
        found.append((name.strip(), parameters.strip()))
    return found


def _read_text(file: CliFile, text: str) -> None:
    commands = _commands(text)
    assert commands[0] == ("GEOMETRYSTART", "")
    assert commands[-1] == ("GEOMETRYEND", "")
    for name, parameters in commands[1:-1]:
        numbers = parameters.split(",")
        if name == "LAYER":
            file.layers.append((float(numbers[0]) * file.units, []))
        else:
            assert name == "POLYLINE", name
            points = np.array([float(number) for number in numbers[3:]]).reshape(-1, 2) * file.units
            assert len(points) == int(numbers[2])
            file.layers[-1][1].append((int(numbers[1]), points))


def _read_binary(file: CliFile, data: bytes, *, aligned: bool) -> None:
    """Commands 127 to 132; the short ones have unsigned 16-bit numbers, the long ones 32-bit integers and floats."""
    at = 0
    while at < len(data):
        (command,) = struct.unpack_from("<H", data, at)
        at += 4 if aligned else 2
        short = command in (128, 129, 131)
        if command in (127, 128):
            (z,) = struct.unpack_from("<H" if short else "<f", data, at)
            at += 2 if short else 4
            file.layers.append((z * file.units, []))
            continue
        assert command in (129, 130), f"unknown command {command} at {at}"
        _, direction, n = struct.unpack_from("<HHH" if short else "<iii", data, at)
        at += 6 if short else 12
        points = np.frombuffer(data, "<u2" if short else "<f4", 2 * n, at).astype(np.float64)
        at += (4 if short else 8) * n
        file.layers[-1][1].append((direction, points.reshape(-1, 2) * file.units))


@dataclass
class SlcFile:
    """An SLC file: keywords, (z, thickness, compensation, reserved) of the table, (z, [points]) of each layer."""

    header: dict[str, str]
    table: list[tuple[float, float, float, float]]
    layers: list[tuple[float, list[Float]]]
    top: float
    gaps: int


def read_slc(data: bytes) -> SlcFile:
    """All of an SLC file, to its last byte."""
    head, end, _ = data.partition(b"\r\n\x1a")
    assert end
    assert len(head) + len(end) <= 2048
    words = re.split(r"(?:^|\s)-(?=[A-Z])", head.decode("ascii"))
    header = {key: value for key, _, value in (word.partition(" ") for word in words if word)}
    at = len(head) + len(end)
    assert data[at : at + 256] == bytes(256)
    at += 256
    (n_entries,) = struct.unpack_from("<B", data, at)
    table = [struct.unpack_from("<4f", data, at + 1 + 16 * i) for i in range(n_entries)]
    at += 1 + 16 * n_entries
    layers: list[tuple[float, list[Float]]] = []
    all_gaps = 0
    while True:
        z, n_boundaries = struct.unpack_from("<fI", data, at)
        at += 8
        if n_boundaries == 0xFFFFFFFF:
            assert at == len(data), "more after the end"
            return SlcFile(header, table, layers, z, all_gaps)
        rings = []
        for _ in range(n_boundaries):
            n_points, n_gaps = struct.unpack_from("<II", data, at)
            all_gaps += n_gaps
            rings.append(np.frombuffer(data, "<f4", 2 * n_points, at + 8).astype(np.float64).reshape(-1, 2))
            at += 8 + 8 * n_points
        layers.append((z, rings))


@dataclass
class SvgLayer:
    """A group of an SVG: its attributes without the namespace, and its rings in the coordinates of the part."""

    attributes: dict[str, str]
    rings: list[Float]

    @property
    def z(self) -> float:
        return float(self.attributes["z"])


def read_svg(data: bytes) -> tuple[dict[str, str], str, list[SvgLayer]]:
    """Attributes of the root, the description, and the groups in it."""
    root = ET.fromstring(data)
    assert root.tag == f"{SVG}svg"
    x0, y1 = float(root.attrib["data-x"]), float(root.attrib["data-y"])
    described = root.findtext(f"{SVG}desc") or ""
    layers = []
    for group in root.findall(f"{SVG}g"):
        own = {name.rpartition("}")[2]: value for name, value in group.attrib.items()}
        assert f"{SLIC3R}z" in group.attrib
        rings = []
        for path in group.findall(f"{SVG}path"):
            assert path.attrib["fill-rule"] == "evenodd"
            rings += [ring * (1, -1) + (x0, y1) for ring in _path_rings(path.attrib["d"])]
        layers.append(SvgLayer(own, rings))
    return dict(root.attrib), described, layers


def _path_rings(d: str) -> list[Float]:
    """Closed polylines of absolute path data: M, further pairs are lines, Z."""
    rings = []
    for piece in d.split("Z")[:-1]:
        assert piece.split()[0] == "M"
        numbers = re.findall(r"-?\d+(?:\.\d+)?", piece)
        rings.append(np.array([float(number) for number in numbers]).reshape(-1, 2))
    assert d.rstrip().endswith("Z")
    return rings
