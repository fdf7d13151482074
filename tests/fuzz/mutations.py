"""Damage to files that keeps much of their structure: flipped bytes, moved blocks, lying lengths, extreme numbers."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from random import Random

Files = Mapping[str, bytes]
"""The files of an input by name; the first one is what a reader is given, and the others lie beside it."""

NUMBERS = (0, 1, 2, *(base + near for base in (1 << 7, 1 << 8, 1 << 15, 1 << 16, 1 << 31, 1 << 32, 1 << 63, 1 << 64)
                      for near in (-1, 0)), 1 << 40)  # fmt: skip
FLOATS = (0.0, -0.0, float("nan"), float("inf"), float("-inf"), 1e300, -1e300, 1e-300, 1e9, -1.0, 90.1, 181.0, 4e18)
WORDS = (
    *(b"nan", b"inf", b"-inf", b"1e308", b"1e999", b"-1", b"0", b"-0", b"9" * 25, b"9" * 5000, b"0x10", b"1_0", b"."),
    *(b"", b"99", b"18446744073709551616", b"-9223372036854775808", b"1e-320", b"null", b"true", b"[]", b"{}", b'""'),
)
TEXTS = (
    *(b"\0", b"\r", b"\n\n", b"\xff\xfe", b"\xed\xa0\x80", b"\xef\xbb\xbf", b"\x1b[2J", b'"', b"'", b",", b";", b"*"),
    *(b"<", b"&a;", b"../../x", b"/etc/x", b"<![CDATA[", b"[[", b"\xe5\x9c\x83\xe5\xa0\xb4", b"A" * 3000, b"(((("),
    b" " * 300,
)
_NUMBER = re.compile(rb"[-+]?\d+(\.\d*)?")
_FIELD = re.compile(rb"[^,;\s<>\"=]+")


def mutant(seeds: Sequence[Files], mend: Callable[[bytes], bytes] | None, chance: Random) -> dict[str, bytes]:
    """One damaged input: a seed, with one of its files changed one to five times.

    Args:
        seeds: valid inputs.
        mend: makes checksums right again, so that damage reaches what is behind them; half of the inputs are mended.
        chance: decides.
    """
    files = dict(chance.choice(seeds))
    name = chance.choice(list(files))
    other = files[name] if len(seeds) == 1 else chance.choice(seeds).get(name, files[name])
    data = bytearray(files[name])
    is_text = sum(byte < 9 for byte in data[:256]) == 0
    for _ in range(min(5, 1 + int(chance.expovariate(0.8)))):
        if is_text and chance.random() < 0.8:
            _in_text(data, chance)
        elif chance.random() < 0.03:
            _splice(data, other, chance)
        else:
            chance.choice(_CHANGES)(data, chance)
    files[name] = bytes(data)
    if mend is not None and chance.random() < 0.5:
        files[name] = mend(files[name])
    return files


def _place(data: bytearray, chance: Random, size: int = 1) -> int:
    """A place with `size` bytes from it, more often near the beginning, where headers are."""
    room = max(1, len(data) - size + 1)
    return chance.randrange(min(room, chance.choice((64, 512, room, room))))


def _block(data: bytearray, chance: Random) -> slice:
    """A piece of a few bytes to a quarter of the data."""
    start = _place(data, chance)
    size = min(chance.choice((1, 2, 4, 8, 16, 34, 64, 256, 1 + len(data) // 4)), 1 << 14)
    return slice(start, start + 1 + chance.randrange(size))


def _flip(data: bytearray, chance: Random) -> None:
    if data:
        data[_place(data, chance)] ^= 1 << chance.randrange(8)


def _byte(data: bytearray, chance: Random) -> None:
    if data:
        data[_place(data, chance)] = chance.choice((0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)))


def _number(data: bytearray, chance: Random) -> None:
    """An integer at any place becomes an extreme one, as a length that lies."""
    size, order = chance.choice((1, 2, 4, 4, 8)), chance.choice(("little", "little", "big"))
    at = _place(data, chance, size)
    value = chance.choice((*NUMBERS, len(data), len(data) + 1)) & ((1 << (8 * size)) - 1)
    data[at : at + size] = value.to_bytes(size, order)  # type: ignore[arg-type]


def _near(data: bytearray, chance: Random) -> None:
    """An integer at any place becomes a near or related one."""
    size, order = chance.choice((1, 2, 4, 8)), chance.choice(("little", "little", "big"))
    at = _place(data, chance, size)
    value = int.from_bytes(data[at : at + size], order)  # type: ignore[arg-type]
    value = chance.choice((value + 1, value - 1, value * 2, value // 2, -value, value << 8, ~value, value + 7))
    data[at : at + size] = (value & ((1 << (8 * size)) - 1)).to_bytes(size, order)  # type: ignore[arg-type]


def _float(data: bytearray, chance: Random) -> None:
    form = chance.choice(("<d", "<d", "<f", ">d", ">f"))
    value = chance.choice(FLOATS)
    put = struct.pack(form, value if form[1] == "d" else max(-3e38, min(3e38, value)))
    at = _place(data, chance, len(put))
    data[at : at + len(put)] = put


def _cut(data: bytearray, chance: Random) -> None:
    del data[_place(data, chance) :]


def _remove(data: bytearray, chance: Random) -> None:
    del data[_block(data, chance)]


def _double(data: bytearray, chance: Random) -> None:
    block = _block(data, chance)
    data[block.start : block.start] = data[block]


def _move(data: bytearray, chance: Random) -> None:
    """A block is copied to another place, over what was there."""
    block = bytes(data[_block(data, chance)])
    at = _place(data, chance, len(block))
    data[at : at + len(block)] = block


def _fill(data: bytearray, chance: Random) -> None:
    block = _block(data, chance)
    size = len(data[block])
    data[block] = chance.choice((bytes(size), b"\xff" * size, chance.randbytes(size)))


def _insert(data: bytearray, chance: Random) -> None:
    at = _place(data, chance)
    data[at:at] = chance.choice(
        (bytes(8), b"\xff" * 4, chance.randbytes(chance.randrange(1, 40)), chance.choice(TEXTS))
    )


def _splice(data: bytearray, other: bytes, chance: Random) -> None:
    """The rest of another input follows."""
    data[_place(data, chance) :] = other[chance.randrange(len(other) or 1) :]


_CHANGES = (
    *(_flip, _flip, _byte, _byte, _number, _number, _near, _near),
    *(_float, _cut, _remove, _double, _move, _fill, _insert),
)


def _in_text(data: bytearray, chance: Random) -> None:
    """A number, a field or a line is changed, doubled or removed."""
    kind = chance.randrange(8)
    if kind < 5:
        found = (_NUMBER if kind < 3 else _FIELD).search(data, _place(data, chance))
        if found is not None:
            words = WORDS if kind < 3 else (*WORDS, *TEXTS, found[0] * 2, found[0][:-1])
            data[found.start() : found.end()] = chance.choice(words)
    elif kind == 5:
        at = _place(data, chance)
        data[at:at] = chance.choice(TEXTS)
    else:
        start = data.rfind(b"\n", 0, _place(data, chance)) + 1
        end = (data.find(b"\n", start) + 1) or len(data)
        line = bytes(data[start:end])
        if kind == 6:
            del data[start:end]
        else:
            at = data.rfind(b"\n", 0, _place(data, chance)) + 1
            data[at:at] = line * chance.choice((1, 1, 2, 50))
