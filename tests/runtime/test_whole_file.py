import os
from pathlib import Path

import pytest

from poil_drake.runtime.whole_file import whole_file as dut


def test_file_appears_at_the_end(tmp_path):
    path = tmp_path / "folder" / "figures.json"

    with dut(path) as file:
        file.write(b"all")
        assert not path.exists()

    assert path.read_bytes() == b"all"
    assert os.listdir(path.parent) == [path.name]


def test_old_file_stays_where_writing_fails(tmp_path):
    path = tmp_path / "figures.json"
    path.write_bytes(b"old")

    def write_half() -> None:
        with dut(path) as file:
            file.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()

    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [path.name]


def test_file_can_be_read_by_whom_the_user_lets(tmp_path):
    ordinary, path = tmp_path / "ordinary", tmp_path / "figures.json"
    ordinary.write_bytes(b"")

    with dut(path) as file:
        file.write(b"all")

    assert path.stat().st_mode == ordinary.stat().st_mode


def test_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_bytes(b"old")
    link.symlink_to(target)

    with dut(link) as file:
        file.write(b"new")

    assert link.is_symlink()
    assert target.read_bytes() == b"new"


def test_device_is_written_to_and_stays():
    with dut(Path("/dev/null")) as file:
        file.write(b"all")

    assert Path("/dev/null").is_char_device()


def test_a_pipe_is_written_to_directly():
    read, write = os.pipe()

    with dut(Path(f"/dev/fd/{write}")) as file:
        file.write(b"new")

    os.close(write)
    assert os.read(read, 10) == b"new"
    os.close(read)
