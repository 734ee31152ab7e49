import os
from pathlib import Path

import pytest

from poil_drake.diagrams.run.report import OutputPaths
from poil_drake.runtime.output_files import OutputError, require_writable


def test_folders_are_made_and_files_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "new" / "plan.npz"

    require_writable(path)
    assert list(path.parent.iterdir()) == []
    path.write_text("kept")
    require_writable(path)

    assert path.read_text() == "kept"
    assert [p.name for p in path.parent.iterdir()] == ["plan.npz"]


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"is a folder.*Name a file"):
        require_writable(tmp_path)


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(OutputError, match=r"cannot be written.*Choose a folder"):
        require_writable(tmp_path / "file" / "plan.npz")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder that nobody can write to")
def test_a_folder_that_cannot_be_written_to_is_refused() -> None:
    with pytest.raises(OutputError, match=r"'/proc/self/run\.html' cannot be written"):
        require_writable(Path("/proc/self/run.html"))


def test_old_outputs_are_removed(tmp_path: Path) -> None:
    dut = OutputPaths.under(tmp_path)
    dut.json.write_text("{}")

    dut.remove()

    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["html", "mcap", "png", "json"])
def test_an_output_that_is_a_folder_is_refused(kind: str, tmp_path: Path) -> None:
    (tmp_path / f"run.{kind}").mkdir()

    with pytest.raises(OutputError, match=f"run.{kind}' is a folder"):
        OutputPaths.under(tmp_path).remove()


def test_two_outputs_in_one_file_are_refused(tmp_path: Path) -> None:
    same = tmp_path / "run.txt"

    with pytest.raises(OutputError, match="'html' and 'json' both go to"):
        OutputPaths(html=same, json=same).remove()


@pytest.mark.parametrize("name", ["run.gif", "run"])
def test_a_picture_of_unknown_format_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"\.png, \.pdf, \.svg"):
        OutputPaths(png=tmp_path / name).remove()


def test_outputs_can_be_checked_without_removing_them(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")

    OutputPaths.under(tmp_path).check()

    assert (tmp_path / "run.json").exists()


def test_only_regular_files_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    removed: list[Path] = []
    monkeypatch.setattr(Path, "unlink", lambda path, missing_ok: removed.append(path))

    OutputPaths(json=pipe, mcap=Path("/dev/stdout"), png=Path("/dev/null")).unlink()

    assert removed == []
