"""`poil doctor --cameras` on rendered and recorded images."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Command

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.perception.images import MultiViewFrame
from poil_drake.recording.demonstration.writer import DemonstrationWriter

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def frame(scenario: Scenario) -> MultiViewFrame:
    station = MakeStation(scenario, ignore_output_delay=True)
    return CaptureFrame(station, station.CreateDefaultContext())


def write(path: Path, frame: MultiViewFrame) -> None:
    names = [camera.name for camera in frame.cameras]
    later = tuple(replace(image, stamp=image.stamp + 0.1) for image in frame.images)
    with DemonstrationWriter(path, names, {}) as writer:
        writer.write(frame)
        writer.write(replace(frame, images=later))


def test_the_shipped_cameras_are_well(command: Command) -> None:
    done = command("doctor", "--cameras")

    assert done.status == 0, done.out
    starts = ("ok  left  ", "ok  right  ", "ok  left and right ")
    for line, start in zip(done.out.splitlines(), starts, strict=True):
        assert line.startswith(start)


def test_a_wrong_table_height_is_told(command: Command) -> None:
    done = command("doctor", "--cameras", "--scenario_text", "{poil: {table_height: 0.03}}")

    assert done.status == 1
    assert done.out.startswith("NO  table        all cameras see the table at 0.000")


def test_a_recorded_camera_with_wrong_depth_is_told(
    command: Command, frame: MultiViewFrame, tmp_path: Path
) -> None:
    left, right = frame.images
    wrong = replace(left, depth=(1.03 * left.depth).astype(np.float32))
    write(tmp_path / "wrong.mcap", replace(frame, images=(wrong, right)))

    done = command("doctor", "--cameras", "--recording", "wrong.mcap")

    assert done.status == 1
    rows = done.out.splitlines()
    assert rows[0].startswith("NO  left         table -1")
    assert "Its depth is 2.9 % too large" in rows[1] or "Its depth is 3.0 % too large" in rows[1]
    assert rows[2].startswith("ok  right ")
    assert "First mend left, then check again." in rows[4]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--hardware"], "need --cameras"),
        (["cell.yaml"], "need --cameras"),
        (["--cameras", "--hardware", "--recording", "a.mcap"], "exclude each other"),
        (["--cameras", "--recording", "a.mcap"], "a.mcap"),
        (["--cameras", "--scenario_text", "{cameras: {left: {width: 0}}}"], "cameras.left"),
    ],
)
def test_mistakes_end_with_one_line(command: Command, arguments: list[str], problem: str) -> None:
    done = command("doctor", *arguments)

    assert done.status != 0
    assert problem in done.error
