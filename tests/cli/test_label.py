"""`poil label`, with a stand-in for the page."""

from pathlib import Path
from typing import Any

import pytest
from block_scene import OBJECT, TABLE, make_scene
from command_line import Command

from poil_drake.diagrams.scenario.load import default_scenario_file
from poil_drake.perception.detectors.by_hand.hand_labels import INCLUDE, HandLabels, Mark
from poil_drake.recording.demonstration.writer import DemonstrationWriter

MARK = Mark(view="left", role="object", kind=INCLUDE, at=(80, 60))


class StandInPage:
    """Takes the place of `MarkPage`: a person makes one mark and presses "Done"."""

    url = "http://127.0.0.1/token/"

    def __init__(self, *, images: dict, store: Any, masks: Any, **kwargs: Any):
        self.images, self.store, self.masks = images, store, masks

    def __enter__(self) -> "StandInPage":
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def wait(self) -> None:
        marks = self.store.add(MARK)
        shown = self.masks(marks)
        for role in ("object", "part", "fixture"):
            assert {name: mask.shape for name, mask in shown[role].items()} == {
                name: image.shape[:2] for name, image in self.images.items()
            }


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("poil_drake.reports.mark_page.MarkPage", StandInPage)


@pytest.fixture
def demo(tmp_path: Path) -> str:
    with DemonstrationWriter(tmp_path / "demo.mcap", ["left", "right"], {}) as writer:
        for stamp in (0.0, 0.125):
            writer.write(make_scene(stamp=stamp).frame)
    return "demo.mcap"


def test_labels_of_a_demonstration_are_saved_beside_it_and_continued(
    command: Command, demo: str
) -> None:
    first, second = command("label", demo), command("label", demo)

    assert first.out == f"open {StandInPage.url}\n1 marks are in demo.labels.json\n"
    assert (second.status, second.out) == (0, first.out)
    assert HandLabels.load("demo.labels.json").marks == (MARK,)


@pytest.mark.render
def test_labels_of_a_scenario_are_saved_where_the_user_says(command: Command) -> None:
    command("label", str(default_scenario_file()), "-o", "mug.json")

    labels = HandLabels.load("mug.json")
    assert {name: (view.width, view.height) for name, view in labels.views.items()} == {
        "left": (640, 480),
        "right": (640, 480),
    }


def test_labels_of_another_scene_are_refused_before_the_page_opens(
    command: Command, demo: str
) -> None:
    other = make_scene({"table": TABLE, "object": OBJECT})
    HandLabels.of(other.frame).save("demo.labels.json")

    dut = command("label", demo)

    assert dut.status == 1
    assert "labels of other images: those of left, right differ" in dut.error
    assert dut.out == ""


def test_a_scenarios_options_do_not_work_with_a_demonstration(command: Command, demo: str) -> None:
    dut = command("label", demo, "--hardware")

    assert dut.status == 2
    assert "do not work with a demonstration" in dut.error


def test_labels_do_not_replace_the_scene(command: Command, demo: str) -> None:
    assert "would overwrite the input" in command("label", demo, "-o", demo).error
