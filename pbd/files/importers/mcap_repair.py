"""Checks an MCAP file before rosbags opens it: a truncated file is repaired in a copy, a zip bomb is refused."""

import mmap
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

from pbd.errors import RecordingError, in_words, warn
from pbd.io.atomic import is_file
from pbd.io.read_file import read_text, refuse_bomb

MCAP_MAGIC = b"\x89MCAP0\r\n"
MCAP_FOOTER = b"\x02" + struct.pack("<Q", 20) + bytes(20) + MCAP_MAGIC
"""The end of an MCAP file without an index (mcap.dev/spec)."""

CHUNK, CHUNK_HEAD = 6, struct.Struct("<QQQII")
"""The type of a chunk, and its fixed beginning."""


@contextmanager
def repaired_bag(path: Path) -> Iterator[Path]:
    """Yield the bag, or the copy of an MCAP file whose missing end was repaired; RecordingError: a zip bomb."""
    for file in _mcap_files(path):
        data = _mapped(file)
        if data[: len(MCAP_MAGIC)] != MCAP_MAGIC:
            raise RecordingError.at(file, "it is no MCAP (its first bytes say so); give another file")
        parts, end = _complete_records(file, data)
        if data[-len(MCAP_MAGIC) :] == MCAP_MAGIC and end == len(data) - len(MCAP_MAGIC):
            continue
        what = f"{file}: its end is missing, as after a crash; it is read as far as it goes"
        if file != path:
            raise RecordingError(f"{what} if you import it instead of its folder", path=file)
        warn(what)
        with TemporaryDirectory() as folder:
            copy = Path(folder) / "repaired.mcap"
            copy.write_bytes(MCAP_MAGIC + b"".join(data[part] for part in parts) + MCAP_FOOTER)
            yield copy
        return
    yield path


def _mcap_files(path: Path) -> list[Path]:
    """Return the MCAP files that rosbags will open. Compressed files are refused: rosbags does not bound their size."""
    if not path.is_dir():
        return [path] if path.suffix.lower() == ".mcap" else []
    from ruamel.yaml import YAML

    text = read_text(path / "metadata.yaml", RecordingError, "give a bag that is whole")
    about = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
    files = [path / PurePath(name).name for name in about["relative_file_paths"]]
    if files and (about.get("compression_mode") or "").lower() == "file":
        name, plain = files[0].name, files[0].stem
        what = f"{name} is compressed as a whole; unpack it with: zstd -d {name} -o {plain}, and import {plain}"
        raise RecordingError.at(path, what)
    return files if about["storage_identifier"] == "mcap" else []


def _mapped(path: Path) -> mmap.mmap | bytes:
    """Map a file into memory: a bag may be larger than the memory."""
    if not is_file(path):  # a pipe waits for its writer
        raise RecordingError.at(path, "there is no such file; give a bag that is whole")
    try:
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError:  # an empty file can't be mapped
        return b""
    except OSError as reason:
        raise RecordingError.at(path, f"can't be read ({in_words(reason)}); give a bag") from None


def _complete_records(path: Path, data: mmap.mmap | bytes, at: int = len(MCAP_MAGIC)) -> tuple[list[slice], int]:
    """Return the parts of the file with complete records, from byte `at` on, and the end of the last one.

    An uncompressed last chunk that is cut off contributes its complete records.
    """
    begin = at
    while at + 9 <= len(data):
        kind, (size,) = data[at], struct.unpack_from("<Q", data, at + 1)
        inside = at + 9 + CHUNK_HEAD.size + 8
        if kind == CHUNK and inside <= len(data):
            _, _, contents, _, compression = CHUNK_HEAD.unpack_from(data, at + 9)
            refuse_bomb(path, "a chunk", size, contents, harmless=500_000)  # of many
            if at + 9 + size > len(data) and compression == 0:
                inner, end = _complete_records(path, data, inside)
                return [slice(begin, at), *inner], end
            if at + 9 + size <= len(data) and compression:
                packed = data[inside + compression : at + 9 + size]
                if not _decompresses(data[inside - 8 : inside - 8 + compression], packed, contents):
                    what = f"a chunk of {size} bytes is damaged, or holds more than it says; record it again"
                    raise RecordingError.at(path, what, value=contents)
        if at + 9 + size > len(data):
            break
        at += 9 + size
    return [slice(begin, at)], at


def _decompresses(compression: bytes, packed: bytes, size: int) -> bool:
    """Whether decompression gives exactly `size` bytes. rosbags does not bound it."""
    import lz4.frame  # type: ignore[import-untyped]

    zstd = zstd_package()
    kinds = {b"zstd": zstd.ZstdDecompressor, b"lz4": lz4.frame.LZ4FrameDecompressor}
    try:
        unpacker = kinds[compression]()
        unpacked = unpacker.decompress(packed, max_length=size + 1)
    except (KeyError, EOFError, RuntimeError, zstd.ZstdError):
        return False
    return len(unpacked) == size and unpacker.eof and not unpacker.unused_data


def zstd_package() -> Any:
    """Return the package with which rosbags decompresses."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd
