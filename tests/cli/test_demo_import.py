"""The command `poil demo import`."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Command
from ros_bags import RosRecording

from poil_drake.diagrams.scenario.load import default_scenario_file
from poil_drake.recording.demonstration.demonstration import load_demonstration

CAMERAS = ("--camera", "left=/left", "--camera", "right=/right")


@pytest.fixture
def bag(tmp_path: Path) -> str:
    RosRecording.of_small_frames().write_folder(tmp_path / "bag")
    return "bag"


def test_an_import_prints_what_it_took(command: Command, bag: str) -> None:
    dut = command("demo", "import", bag, "-o", "demo.mcap", *CAMERAS)

    assert dut.status == 0
    lines = dut.out.splitlines()
    assert lines[0].split() == ["/camera/left/image", "/left/color/image_raw"]
    assert lines[-1] == "imported 5 frames (0.5 s) to demo.mcap"
    assert len(load_demonstration("demo.mcap").frames) == 5


def test_without_cameras_the_contents_are_listed(command: Command, bag: str) -> None:
    dut = command("demo", "import", bag)

    assert dut.status == 1
    assert "/left/color/image_raw (5 sensor_msgs/msg/Image in frame" in dut.error
    assert "--camera left=/left" in dut.error


def test_topics_and_labels_can_be_named(command: Command, bag: str) -> None:
    dut = command(
        *("demo", "import", bag, *CAMERAS, "--label", "mug=3,4"),
        *("--topic", "left/depth=/right/color/camera_info"),
    )

    assert dut.status == 1
    assert "/right/color/camera_info, for the depth of camera 'left', holds" in dut.error


def test_label_images_without_names_are_mentioned(command: Command, bag: str) -> None:
    label = ("--topic", "left/label=/right/aligned_depth_to_color/image_raw")

    dut = command("demo", "import", bag, "-o", "demo.mcap", "--camera", "left=/left", *label)

    assert dut.status == 0
    assert "without --label, no object is known" in dut.out


@pytest.mark.parametrize("output", ["bag", "bag/bag_0.mcap"])
def test_the_bag_is_never_overwritten(command: Command, bag: str, output: str) -> None:
    dut = command("demo", "import", bag, "-o", output, *CAMERAS)

    assert dut.status == 1
    assert f"The output '{output}' would overwrite the input 'bag'" in dut.error
    assert command("demo", "import", bag, "-o", "demo.mcap", *CAMERAS).status == 0


@pytest.mark.parametrize("part", [("--start", "20"), ("--end", "-1"), ("--start", "nan")])
def test_a_part_without_images_is_refused(
    command: Command, bag: str, part: tuple[str, str]
) -> None:
    dut = command("demo", "import", bag, "-o", "demo.mcap", *CAMERAS, *part)

    assert dut.status == 1
    assert "no image of topic /left/color/image_raw was logged from" in dut.error
    assert "--start and --end" in dut.error


def test_the_poses_can_be_those_of_a_scenario(command: Command, bag: str) -> None:
    scenario = str(default_scenario_file())

    dut = command("demo", "import", bag, "-o", "demo.mcap", *CAMERAS, "--scenario", scenario)

    assert dut.status == 0
    left, right = load_demonstration("demo.mcap").cameras
    np.testing.assert_allclose(left.X_WC[:3, 3], [0.82, 0.38, 0.56], atol=1e-12)
    np.testing.assert_allclose(right.X_WC[:3, 3], [0.76, -0.43, 0.60], atol=1e-12)


def test_the_scenario_must_have_the_cameras(command: Command, bag: str) -> None:
    scenario = str(default_scenario_file())

    dut = command("demo", "import", bag, "--camera", "top=/left", "--scenario", scenario)

    assert dut.status == 1
    assert "The scenario has no camera 'top'; it has left, right." in dut.error
