import os
from pathlib import Path

import pytest

from poil_drake.runtime.output_files import OutputError, require_writable, whole_file


def test_require_writable_makes_folders_and_leaves_files_alone(tmp_path: Path) -> None:
    path = tmp_path / "new" / "plan.npz"

    require_writable(path)
    assert list(path.parent.iterdir()) == []
    path.write_text("kept")
    require_writable(path)

    assert path.read_text() == "kept"
    assert [p.name for p in path.parent.iterdir()] == ["plan.npz"]


def test_a_folder_is_not_a_file(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"is a folder.*Name a file"):
        require_writable(tmp_path)


def test_a_file_is_not_a_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(OutputError, match=r"cannot be written.*Choose a folder"):
        require_writable(tmp_path / "file" / "plan.npz")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no read-only folder")
def test_a_read_only_folder_is_rejected() -> None:
    with pytest.raises(OutputError, match=r"'/proc/self/run\.html' cannot be written"):
        require_writable(Path("/proc/self/run.html"))


def test_the_file_appears_at_the_end(tmp_path):
    path = tmp_path / "folder" / "figures.json"

    with whole_file(path) as file:
        file.write(b"all")
        assert not path.exists()

    assert path.read_bytes() == b"all"
    assert os.listdir(path.parent) == [path.name]


def test_the_old_file_stays_if_writing_fails(tmp_path):
    path = tmp_path / "figures.json"
    path.write_bytes(b"old")

    def write_half() -> None:
        with whole_file(path) as file:
            file.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()

    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [path.name]


def test_the_file_has_the_users_default_mode(tmp_path):
    ordinary, path = tmp_path / "ordinary", tmp_path / "figures.json"
    ordinary.write_bytes(b"")

    with whole_file(path) as file:
        file.write(b"all")

    assert path.stat().st_mode == ordinary.stat().st_mode


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_bytes(b"old")
    link.symlink_to(target)

    with whole_file(link) as file:
        file.write(b"new")

    assert link.is_symlink()
    assert target.read_bytes() == b"new"


def test_a_device_is_written_to_directly():
    with whole_file(Path("/dev/null")) as file:
        file.write(b"all")

    assert Path("/dev/null").is_char_device()


def test_a_pipe_is_written_to_directly():
    read, write = os.pipe()

    with whole_file(Path(f"/dev/fd/{write}")) as file:
        file.write(b"new")

    os.close(write)
    assert os.read(read, 10) == b"new"
    os.close(read)
