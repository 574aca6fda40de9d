"""What is done to a file: bytes changed, lost, doubled, cut off; words of it replaced by words that break readers."""

import random
import re

DICTIONARY = (
    *(
        b"nan",
        b"inf",
        b"-inf",
        b"1e308",
        b"-1e308",
        b"1e400",
        b"1e-400",
        b"-0",
        b"0",
        b"-1",
        b"1",
        b"2",
        b"1e9",
        b"1e20",
    ),
    *(b"1_000", b"0x10", b"0x1p3", b"4294967296", b"9223372036854775808", b"99999999999", b"1e", b".", b"-", b"+"),
    *(
        "１２".encode(),
        "²".encode(),
        "\u2028".encode(),
        "é".encode("latin-1"),
        "日本".encode("shift_jis"),
        b"\xef\xbb\xbf",
    ),
    *(b"9" * 400, b"9" * 5000, b"0." + b"0" * 400 + b"1", b"0x" + b"f" * 6000, b"1" * 200_000),
    *(
        b"[" * 5000,
        b"{a=" * 3000,
        b"(" * 5000,
        b"a." * 5000,
        b"<a>" * 3000,
        b"[[a]]\n" * 2000,
        b"[" * 9 + b"1" + b"]" * 9,
    ),
    *(b"," * 5000, b";" * 5000, b"\t" * 1200, b"a" * 300, b"a" * 70_000, b"\n" * 1000, b" " * 5000),
    *(b"\xed\xa0\x80", b"\\ud800", b"\\u001b[2J", b"\x1b[2J", b"\x00", b"\xff\xfe", b"\xfe\xff\x00", b"\r", b"\x85"),
    *(b'"', b"'", b'"""', b"#", b"=", b"\\", b"&#0;", b"&amp;", b"&a;", b"]]>", b"--", b"/>", b"<", b">"),
    *(b'encoding="utf-7"', b'encoding="shift_jis"', b'encoding="nonsense"', b"<!DOCTYPE a [<!ENTITY a 'b'>]>"),
    *(
        b"package://",
        b"~nouser/a",
        b"file://",
        b"/dev/zero",
        b"/",
        b"..",
        b"2026-13-45",
        b"true",
        b"07:32:00",
        b"8:18:9:94",
    ),
    *(b"PK\x05\x06", b"\x93NUMPY", b"(1000000000, 3)", b"|O", b"<f16", b"<c16", b"\xff\xff\xff\x7f"),
)
"""Words that have broken readers: numbers that are none or that only Python reads, nesting, width, encodings, paths."""

_WORD = re.compile(rb"[\w.+\-]+")


def mutated(data: bytes, rng: random.Random) -> bytes:
    """The data after one to three mishaps."""
    result = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        _mutate(result, rng)
    return bytes(result)


def _mutate(data: bytearray, rng: random.Random) -> None:
    at, run = rng.randrange(len(data) + 1), rng.choice((1, 1, 2, 8, 60, 400))
    kind = rng.randrange(8)
    if kind == 0 and at < len(data):
        data[at] ^= 1 << rng.randrange(8)
    elif kind == 1:
        del data[at : at + run]
    elif kind == 2:
        data[at:at] = data[at : at + run] * rng.choice((1, 1, 50))
    elif kind == 3:
        del data[at:]
    elif kind == 4:
        data[at : at + rng.choice((0, run))] = rng.choice(DICTIONARY)
    elif kind == 5:
        data[at:at] = bytes(rng.randrange(256) for _ in range(min(run, 60)))
    elif words := list(_WORD.finditer(data)):
        word = rng.choice(words)
        data[word.start() : word.end()] = rng.choice(DICTIONARY)
