from pathlib import Path

import pytest

from poil_drake.runtime.user_cache import cached_directory


@pytest.fixture(autouse=True)
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
