import os
from pathlib import Path

import pytest

from poil_drake.runtime.output_files import (
    OutputError,
    require_writable,
    whole_file,
)
from poil_drake.runtime.user_cache import cached_directory


def test_require_writable_makes_folders_and_leaves_files_alone(tmp_path: Path) -> None:
    path = tmp_path / "new" / "plan.npz"

    require_writable(path)
    assert list(path.parent.iterdir()) == []
    path.write_text("kept")
    require_writable(path)

    assert path.read_text() == "kept"
    assert [p.name for p in path.parent.iterdir()] == ["plan.npz"]


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("", "is a folder.*Choose a file"),
        ("file/plan.npz", "cannot be written.*Choose a folder"),
        pytest.param(
            "/proc/self/run.html",
            r"'/proc/self/run\.html' cannot be written",
            marks=pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc"),
        ),
    ],
)
def test_require_writable_rejects_paths_that_cannot_be_files(
    tmp_path: Path, name: str, error: str
) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(OutputError, match=error):
        require_writable(tmp_path / name)


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


def test_a_pipe_is_written_to_directly():
    read, write = os.pipe()

    with whole_file(Path(f"/dev/fd/{write}")) as file:
        file.write(b"new")

    os.close(write)
    assert os.read(read, 10) == b"new"
    os.close(read)


@pytest.fixture
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "poil_drake"


def test_a_directory_is_made_once_per_version(cache: Path) -> None:
    calls = []

    def make(directory: Path) -> None:
        calls.append(directory)
        (directory / "file").write_text("content")

    first = cached_directory(name="thing", version="1", make=make)
    again = cached_directory(name="thing", version="1", make=make)
    other = cached_directory(name="thing", version="2", make=make)

    assert first == cache / "thing-1"
    assert (first / "file").read_text() == "content"
    assert again == first
    assert other != first
    assert len(calls) == 2


def test_a_failure_leaves_nothing_behind(cache: Path) -> None:
    def make(directory: Path) -> None:
        (directory / "half").write_text("made")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cached_directory(name="thing", version="1", make=make)

    assert list(cache.iterdir()) == []


def test_the_slower_of_two_processes_uses_the_directory_of_the_faster(cache: Path) -> None:
    def make(directory: Path) -> None:
        faster = cache / "thing-1"
        faster.mkdir()
        (faster / "by").write_text("faster")
        (directory / "by").write_text("slower")

    made = cached_directory(name="thing", version="1", make=make)

    assert (made / "by").read_text() == "faster"
    assert [p.name for p in cache.iterdir()] == ["thing-1"]
