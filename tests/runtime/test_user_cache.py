from pathlib import Path

import pytest

from poil_drake.runtime.user_cache import cached_directory, user_cache_directory


@pytest.fixture(autouse=True)
def cache_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_the_cache_follows_xdg(tmp_path: Path) -> None:
    assert user_cache_directory() == tmp_path / "poil_drake"


def test_a_directory_is_made_once_per_version() -> None:
    calls = []

    def make(directory: Path) -> None:
        calls.append(directory)
        (directory / "file").write_text("content")

    first = cached_directory(name="thing", version="1", make=make)
    again = cached_directory(name="thing", version="1", make=make)
    other = cached_directory(name="thing", version="2", make=make)

    assert (first / "file").read_text() == "content"
    assert again == first
    assert other != first
    assert len(calls) == 2


def test_a_failure_leaves_nothing_behind() -> None:
    def make(directory: Path) -> None:
        (directory / "half").write_text("made")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cached_directory(name="thing", version="1", make=make)

    assert list(user_cache_directory().iterdir()) == []


def test_the_slower_of_two_processes_uses_the_directory_of_the_faster() -> None:
    def make(directory: Path) -> None:
        faster = user_cache_directory() / "thing-1"
        faster.mkdir()
        (faster / "by").write_text("faster")
        (directory / "by").write_text("slower")

    made = cached_directory(name="thing", version="1", make=make)

    assert (made / "by").read_text() == "faster"
    assert [p.name for p in user_cache_directory().iterdir()] == ["thing-1"]
