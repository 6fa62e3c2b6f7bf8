"""Small compressed files that expand to gigabytes are refused before they fill the memory."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import tarfile
import tracemalloc
import zipfile
import zlib

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk

from dart_hal.core.errors import FetchFailed, RecordingError
from dart_hal.recording import expansion
from dart_hal.recording.dart.table import read_content
from dart_hal.recording.expansion import ALWAYS_ALLOWED, MAX_RATIO, expand_gzip, expansion_limit
from dart_hal.recording.fetch.local import Local
from dart_hal.recording.mcap_records import MCAP_MAGIC, PREFIX, parse_mcap, record_bytes
from dart_hal.recording.run import RunReader

BOMB = 64 << 20
"""Bytes of zeros: four times what is allowed."""
BLOCK = bytes(1 << 20)
UNKNOWN = 0x99
"""Opcode of a record that MCAP leaves to applications."""
MEMORY = 3 * ALWAYS_ALLOWED
"""Bytes that reading may take in all: the content, its text, a copy on the way."""


def peak(call):
    """Most bytes that Python objects took meanwhile."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def content(size):
    """One record of zeros, in blocks."""
    yield PREFIX.pack(UNKNOWN, size - PREFIX.size) + BLOCK[PREFIX.size:]
    for _ in range(size // len(BLOCK) - 1):
        yield BLOCK


def compress(compressor, size=BOMB, begin=b""):
    return b"".join((begin, *map(compressor.compress, content(size)), compressor.flush()))


def lz4_bomb():
    compressor = lz4.frame.LZ4FrameCompressor()
    return compress(compressor, begin=compressor.begin())


BOMBS = {"zstd": lambda: compress(zstandard.ZstdCompressor().compressobj()), "lz4": lz4_bomb}


def chunk_record(compression, data, size):
    crc = 0
    for block in content(size):
        crc = zlib.crc32(block, crc)
    return record_bytes(Chunk(compression=compression, data=data, message_start_time=0,
                            message_end_time=0, uncompressed_crc=crc, uncompressed_size=size))


def mcap_file(*records):
    """A header, records, and the end of the data."""
    header = PREFIX.pack(Opcode.HEADER, 8) + bytes(8)
    end = PREFIX.pack(Opcode.DATA_END, 4) + bytes(4)
    return MCAP_MAGIC + header + b"".join(records) + end


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_run_that_expands_too_far_is_refused_by_name(tmp_path, compression):
    file = tmp_path / "bomb.mcap"
    file.write_bytes(mcap_file(chunk_record(compression, BOMBS[compression](), BOMB)))
    assert file.stat().st_size < 1 << 20

    def read():
        with pytest.raises(RecordingError, match=r"bomb\.mcap: the file expands too far"):
            RunReader(file)
    assert peak(read) < MEMORY


def test_without_the_limit_it_is_in_the_memory(tmp_path, monkeypatch):
    """Control."""
    monkeypatch.setattr(expansion, "MAX_RATIO", 1e9)
    data = mcap_file(chunk_record("zstd", BOMBS["zstd"](), BOMB))
    assert peak(lambda: parse_mcap(tmp_path, data)) > BOMB


def test_chunks_that_are_allowed_one_by_one_are_limited_together(tmp_path):
    size = 8 << 20
    part = chunk_record("zstd", compress(zstandard.ZstdCompressor().compressobj(), size), size)
    data = mcap_file(*[part] * 20)
    found = []
    assert peak(lambda: found.append(parse_mcap(tmp_path, data))) < MEMORY
    assert found[0].expanded <= expansion_limit(len(data))
    assert found[0].oversized


def test_a_chunk_that_states_a_smaller_size_is_no_chunk(tmp_path):
    bomb = BOMBS["zstd"]()
    data = mcap_file(chunk_record("zstd", bomb, 1 << 20))
    found = []
    assert peak(lambda: found.append(parse_mcap(tmp_path, data))) < MEMORY


@pytest.fixture(scope="module")
def gzip_bomb():
    return compress(zlib.compressobj(6, zlib.DEFLATED, 31))


@pytest.mark.slow
def test_a_csv_that_expands_too_far_is_refused_by_name(tmp_path, gzip_bomb):
    file = tmp_path / "bomb.csv.gz"
    file.write_bytes(gzip_bomb)

    def read():
        with pytest.raises(RecordingError, match=r"bomb\.csv\.gz: the file expands too far"):
            read_content(file)
    assert peak(read) < MEMORY


@pytest.mark.slow
def test_members_of_one_gzip_file_count_together(gzip_bomb):
    part = gzip.compress(bytes(8 << 20))
    with pytest.raises(expansion.ExpandsTooFar):
        expand_gzip(part * 20)


def tar(opener, name, **header):
    """A packed archive with one file of zeros, or with a header that long."""
    raw = io.BytesIO()
    with opener(raw, "wb") as stream, tarfile.open(fileobj=stream, mode="w|") as tape:
        info = tarfile.TarInfo(name)
        info.size = BOMB
        info.pax_headers = header
        tape.addfile(info, Zeros(BOMB))
    return raw.getvalue()


class Zeros(io.RawIOBase):
    def __init__(self, size):
        self._rest = size

    def readable(self):
        return True

    def read(self, size=-1):
        size = min(size, self._rest)
        self._rest -= size
        return BLOCK[:size]


def make_zip(data, name="a.csv"):
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w", zipfile.ZIP_DEFLATED) as archive, \
            archive.open(name, "w") as entry:
        for start in range(0, len(data), len(BLOCK)):
            entry.write(data[start:start + len(BLOCK)])
    return raw.getvalue()


ARCHIVES = {
    "zip": lambda bomb: make_zip(memoryview(BLOCK * 64)),
    "zip of gz": lambda bomb: make_zip(bomb, "a.csv.gz"),
    "tar.gz": lambda bomb: tar(gzip.open, "a.csv"),
    "tar.bz2": lambda bomb: tar(bz2.open, "a.csv"),
    "tar.xz": lambda bomb: tar(lzma.open, "a.csv"),
    "another file in tar.gz": lambda bomb: tar(gzip.open, "b.jpg"),
}


@pytest.mark.parametrize("kind", list(ARCHIVES))
@pytest.mark.slow
def test_an_archive_that_expands_too_far_is_refused_by_name(tmp_path, gzip_bomb, kind):
    file = tmp_path / "bomb"
    file.write_bytes(ARCHIVES[kind](gzip_bomb))
    assert file.stat().st_size < 1 << 20

    def read():
        with pytest.raises(FetchFailed, match="expands too far"):
            Local(file, "bomb", {"data/a.csv": "0" * 64})
    assert peak(read) < MEMORY


@pytest.mark.slow
def test_entries_of_an_archive_count_together(tmp_path):
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w", zipfile.ZIP_DEFLATED) as archive:
        for n in range(3):
            archive.writestr(f"{n}.csv", bytes(8 << 20))
    file = tmp_path / "many.zip"
    file.write_bytes(raw.getvalue())
    with pytest.raises(FetchFailed, match="expands too far"):
        Local(file, "many", {f"{n}.csv": "0" * 64 for n in range(3)})


@pytest.mark.slow
def test_archives_of_every_kind_are_read(tmp_path):
    """Control of the readers: what expands as recordings do is found by its name."""
    text = b"".join(b"%d.25,%d\n" % (n, n * n) for n in range(20000))
    for name, opener in (("a.tar", open), ("a.tar.gz", gzip.open), ("a.tar.bz2", bz2.open),
                         ("a.tar.xz", lzma.open)):
        with opener(tmp_path / name, "wb") as stream, \
                tarfile.open(fileobj=stream, mode="w|") as tape:
            info = tarfile.TarInfo("folder/a.csv")
            info.size = len(text)
            tape.addfile(info, io.BytesIO(text))
    (tmp_path / "a.zip").write_bytes(make_zip(text, "folder/a.csv"))
    (tmp_path / "gz.zip").write_bytes(make_zip(gzip.compress(text), "folder/a.csv.gz"))
    for file in sorted(tmp_path.iterdir()):
        found = Local(file, file.name, {"data/a.csv": "0" * 64})._found
        assert found["a.csv"][1] == text, file.name


def test_a_damaged_archive_of_every_kind_is_refused(tmp_path):
    for name, opener in (("a.tar.gz", gzip.open), ("a.tar.bz2", bz2.open),
                         ("a.tar.xz", lzma.open)):
        with opener(tmp_path / name, "wb") as stream:
            stream.write(b"x" * 5000)
        raw = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(raw[:len(raw) // 2])
    (tmp_path / "noise").write_bytes(b"\x1f\x8b" + b"noise" * 100)
    for file in sorted(tmp_path.iterdir()):
        with pytest.raises(FetchFailed):
            Local(file, file.name, {"data/a.csv": "0" * 64})


def test_the_limit_leaves_room_for_recordings():
    assert expansion_limit(0) == ALWAYS_ALLOWED
    assert expansion_limit(1 << 30) == MAX_RATIO << 30
    text = ("0.000,1,2,3,4,5\n" * 100_000).encode()
    assert expand_gzip(gzip.compress(text)) == text
