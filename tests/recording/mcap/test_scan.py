"""Damaged and malicious files are refused, without much memory."""

import resource
import zlib
from concurrent.futures import ThreadPoolExecutor

import lz4.frame
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer, Header
from mcap.writer import MCAP0_MAGIC

from poil_drake.errors import DemonstrationError
from poil_drake.recording.mcap.scan import LARGEST_CHUNK, CutOffError, scan

HUGE = 4 * LARGEST_CHUNK


def write(path, compression, data, size, crc=0):
    """Writes a file of one chunk."""
    builder = RecordBuilder()
    Header("", "test").write(builder)
    Chunk(
        compression=compression,
        data=data,
        message_start_time=0,
        message_end_time=0,
        uncompressed_crc=crc,
        uncompressed_size=size,
    ).write(builder)
    DataEnd(0).write(builder)
    Footer(0, 0, 0).write(builder)
    path.write_bytes(MCAP0_MAGIC + builder.end() + MCAP0_MAGIC)
    return path


def zeros_zstd(*, sized):
    """A gigabyte of zeros in a few kilobytes, with or without its size."""
    packer = zstandard.ZstdCompressor().compressobj(size=HUGE if sized else -1)
    block = bytes(1 << 24)
    parts = [packer.compress(block) for _ in range(HUGE // len(block))]
    return b"".join([*parts, packer.flush()])


def zeros_lz4():
    packer = lz4.frame.LZ4FrameCompressor()
    block = bytes(1 << 24)
    parts = [packer.begin(), *(packer.compress(block) for _ in range(HUGE // len(block)))]
    return b"".join([*parts, packer.flush()])


@pytest.mark.parametrize("size", [1000, LARGEST_CHUNK, HUGE])
@pytest.mark.parametrize("kind", ["zstd", "zstd without its size", "lz4"])
def test_a_chunk_that_decompresses_to_too_much_is_refused(tmp_path, kind, size):
    data = zeros_lz4() if kind == "lz4" else zeros_zstd(sized=kind == "zstd")
    path = write(tmp_path / "bomb.mcap", kind.split()[0], data, size)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    with pytest.raises(DemonstrationError, match=r"bomb.mcap is damaged in the record at byte"):
        list(scan(path))

    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    assert grown < 2 * LARGEST_CHUNK


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
@pytest.mark.parametrize("records", [b"", bytes([99]) + (4).to_bytes(8, "little") + b"four"])
def test_chunks_of_all_kinds_are_decompressed(tmp_path, compression, records):
    pack = {"": bytes, "zstd": zstandard.compress, "lz4": lz4.frame.compress}[compression]
    path = write(tmp_path / "a.mcap", compression, pack(records), len(records), zlib.crc32(records))

    assert list(scan(path)) == []


def test_a_damaged_length_is_distinguished_from_the_end_of_a_recording(tmp_path):
    data = write(tmp_path / "a.mcap", "", b"", 0).read_bytes()
    at = data.index(Opcode.CHUNK) + 1
    damaged = data[:at] + (1 << 40).to_bytes(8, "little") + data[at + 8 :]

    (tmp_path / "whole.mcap").write_bytes(damaged)
    (tmp_path / "cut.mcap").write_bytes(damaged[:-1])

    with pytest.raises(DemonstrationError, match=r"damaged .* beyond the end of the file"):
        list(scan(tmp_path / "whole.mcap"))
    with pytest.raises(CutOffError):
        list(scan(tmp_path / "cut.mcap"))


def test_files_are_read_on_several_threads_at_once(tmp_path):
    content = bytes(range(256)) * 4096
    records = bytes([0x80]) + len(content).to_bytes(8, "little") + content  # Of an unknown type.
    data, crc = zstandard.compress(records), zlib.crc32(records)
    path = write(tmp_path / "a.mcap", "zstd", data, len(records), crc)

    def read(_: int) -> list:
        return [item for _ in range(100) for item in scan(path)]

    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(read, range(4))) == [[]] * 4
