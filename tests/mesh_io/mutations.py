"""Damage files for tests, from a seed: bytes, runs of bytes, numbers, and the contents of archives."""

from __future__ import annotations

import io
import zipfile
from random import Random  # noqa: TID251 - always with a seed

from tiny_files import zipped

__all__ = ["damaged"]

ODD_BYTES = b"\0\xff\x7f\x80 \n\r\t-+.,<>&\"'/0189eEnN#"
ODD_WORDS = (
    b"-1", b"0", b"1e999", b"nan", b"-inf", b"4294967295", b"2147483648", b"18446744073709551616", b"1e-320", b"0x10",
    b"1_000", b"99999999", b"\xff\xff\xff\xff", b"\0\0\0\x80", b"\xff\xff\xff\x7f", b"<!DOCTYPE a>", b"&a;", b"<a>",
    b"]]>", b"<!--", b"<![CDATA[", b"{", b"[[[[[[", b"null", b"true", b'"', b"solid", b"endsolid\n", b"\xef\xbb\xbf",
    b"\xfe\xff", b"\xe2\x80\xa8", b"PK\3\4", b"PK\1\2", b"PK\5\6",
)  # fmt: skip


def damaged(data: bytes, seed: int) -> bytes:
    """The file after one to four damages; the same seed does the same.

    Every second archive is unpacked, damaged in one member, and packed again; else most damages would only be found by
    its checksums.
    """
    chance = Random(seed)
    if data.startswith(b"PK") and chance.random() < 0.5:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members: dict[str, str | bytes] = {name: archive.read(name) for name in archive.namelist()}
        name = chance.choice(sorted(members))
        content = members[name]
        assert isinstance(content, bytes)
        members[name] = _changed(content, chance)
        return zipped(members)
    return _changed(data, chance)


def _changed(data: bytes, chance: Random) -> bytes:
    result = bytearray(data)
    for _ in range(chance.choice((1, 1, 1, 2, 3, 4))):
        _damage(result, chance)
    return bytes(result)


def _damage(data: bytearray, chance: Random) -> None:
    place = chance.randrange(len(data) + 1)
    length = min(chance.choice((1, 1, 2, 4, 8, 50, 400)), len(data) - place)
    kind = chance.randrange(9)
    if kind == 0 and place < len(data):
        data[place] ^= 1 << chance.randrange(8)
    elif kind == 1 and place < len(data):
        data[place] = chance.choice(ODD_BYTES)
    elif kind == 2:
        data[place : place + length] = chance.randbytes(length)
    elif kind == 3:
        del data[place : place + length]
    elif kind == 4:
        data[place:place] = data[place : place + length] * chance.choice((1, 2, 30))
    elif kind == 5:
        data[place : place + chance.choice((0, 1, 4))] = chance.choice(ODD_WORDS)
    elif kind == 6:
        del data[place:]
    elif kind == 7:
        other = chance.randrange(len(data) + 1)
        data[place : place + length] = data[other : other + length]
    else:
        _replace_number(data, place, chance)


def _replace_number(data: bytearray, place: int, chance: Random) -> None:
    """Another number in place of the next one in the text."""
    while place < len(data) and not 48 <= data[place] <= 57:
        place += 1
    end = place
    while end < len(data) and 48 <= data[end] <= 57:
        end += 1
    data[place:end] = chance.choice((*ODD_WORDS[:12], b"", b"7", b"3", b"12"))
