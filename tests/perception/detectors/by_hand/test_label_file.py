import threading
from pathlib import Path

import pytest
from block_scene import OBJECT, TABLE, make_scene

from poil_drake.errors import InvalidValueError, LabelError
from poil_drake.perception.detectors.by_hand.hand_labels import INCLUDE, HandLabels, Mark
from poil_drake.perception.detectors.by_hand.label_file import LabelFile, parse_mark

FRAME = make_scene().frame


def mark(u: float) -> Mark:
    return Mark(view="left", role="object", kind=INCLUDE, at=(u, 3))


@pytest.fixture
def dut(tmp_path: Path) -> LabelFile:
    return LabelFile(tmp_path / "scene.labels.json", FRAME)


def test_a_mark_is_in_the_file_when_add_returns(dut: LabelFile) -> None:
    assert list(dut.read()) == []

    marks = dut.add(mark(1))

    assert list(marks) == [mark(1)]
    assert HandLabels.load(dut.path).marks == (mark(1),)


def test_a_mark_that_is_sent_twice_is_added_once(dut: LabelFile) -> None:
    dut.add(mark(1))

    assert list(dut.add(mark(1))) == [mark(1)]


def test_undo_removes_the_last_mark_once(dut: LabelFile) -> None:
    for u in range(3):
        dut.add(mark(u))

    dut.undo(3)

    # Another page, which still shows three marks, undoes the same one.
    assert list(dut.undo(3)) == [mark(0), mark(1)]


def test_writers_of_one_file_lose_no_mark(dut: LabelFile) -> None:
    other = LabelFile(dut.path, FRAME)

    def write(file: LabelFile, first: int) -> None:
        for u in range(first, first + 20):
            file.add(mark(u))

    threads = [threading.Thread(target=write, args=pair) for pair in ((dut, 0), (other, 20))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert sorted(mark.at[0] for mark in dut.read()) == list(range(40))


def test_labels_of_other_images_are_refused(dut: LabelFile) -> None:
    other = make_scene({"table": TABLE, "object": OBJECT})
    LabelFile(dut.path, other.frame).add(mark(1))

    with pytest.raises(LabelError, match="other images: those of left, right differ"):
        dut.add(mark(2))


def test_a_refused_mark_leaves_the_file_as_it_was(dut: LabelFile) -> None:
    dut.add(mark(1))

    with pytest.raises(InvalidValueError):
        dut.add(Mark(view="rear", role="object", kind=INCLUDE, at=(1, 1)))

    assert list(dut.read()) == [mark(1)]


@pytest.mark.parametrize("data", [{}, {"view": "left"}, {**vars(mark(1)), "more": 1}])
def test_what_is_no_mark_is_refused(data: dict) -> None:
    with pytest.raises(InvalidValueError, match="is not a mark"):
        parse_mark(data)
