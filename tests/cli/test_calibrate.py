"""`poil calibrate` on views that Drake renders of a board in the robot's hand."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Command
from PIL import Image
from textured_board import board_scenario, postures, render_views, write_board

from poil_drake.diagrams.scenario.load import DumpScenario, LoadScenario, default_scenario_file
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import MakeCameraModels
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.errors import DemonstrationError
from poil_drake.geometry.rigid_transform import make_transform, rotation_angle
from poil_drake.perception.calibration.view_folder import load_views
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.writer import DemonstrationWriter

pytestmark = pytest.mark.render

# Poses that are wrong by some centimetres and degrees, in other frames than the shipped ones.
WRONG = """
cameras:
  left:
    X_PB: { translation: [0.80, 0.41, 0.58], rotation: !Rpy { deg: [-128, 2, 133] } }
  right:
    X_BC: { translation: [0.015, 0.0, 0.002], rotation: !Rpy { deg: [0, 0, 90] } }
    X_PB:
      base_frame: rack::stand
      translation: [0.2, -0.7, 0.6]
      rotation: !Rpy { deg: [-130, 0, -50] }
"""


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[CameraModel, ...]]:
    """A folder of views, and the cameras that took them."""
    folder = tmp_path_factory.mktemp("views")
    scenario = board_scenario(write_board(folder / "model"))
    return folder, render_views(scenario, folder, postures(15))


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A scenario file with wrong poses, which uses the calibration `cameras.yaml` beside it."""
    path = tmp_path / "cell.yaml"
    path.write_text(DumpScenario(LoadScenario(filename=default_scenario_file(), data=WRONG)))
    return path


def camera_models(scenario: Scenario) -> tuple[CameraModel, ...]:
    return MakeCameraModels(MakeStation(scenario, cameras=False).plant(), scenario.cameras)


@pytest.mark.parametrize("keep", [None, "left"])
def test_the_written_poses_are_within_1_mm_and_a_tenth_of_a_degree(
    command: Command,
    views: tuple[Path, tuple[CameraModel, ...]],
    cell: Path,
    tmp_path: Path,
    keep: str | None,
) -> None:
    folder, truth = views
    arguments = [str(cell), "--views", str(folder), "-o", "cameras.yaml"]
    if keep:  # With the right pose of the camera that is kept.
        X_PB = LoadScenario(filename=default_scenario_file()).cameras["left"].X_PB
        rpy = X_PB.rotation.value.deg.tolist()
        pose = f"{{translation: {X_PB.translation.tolist()}, rotation: !Rpy {{deg: {rpy}}}}}"
        arguments += ["--keep", keep, "--scenario_text", f"{{cameras: {{left: {{X_PB: {pose}}}}}}}"]

    done = command("calibrate", "cameras", *arguments)

    assert done.status == 0, done.err
    text = cell.read_text()
    cell.write_text(re.sub(r"calibration: .*", "calibration: cameras.yaml", text))
    calibrated = LoadScenario(filename=cell)
    assert calibrated.cameras["right"].X_PB.base_frame == "rack::stand"
    assert calibrated.poil.calibration == ""  # The poses are in the scenario now.
    for found, true in zip(camera_models(calibrated), truth, strict=True):
        assert np.linalg.norm(found.X_WC[:3, 3] - true.X_WC[:3, 3]) < 1e-3
        assert np.rad2deg(rotation_angle(found.X_WC[:3, :3].T @ true.X_WC[:3, :3])) < 0.1
    expected = "pose kept" if keep else r"38\.00 mm as stated, (37\.9|38\.0)\d \+- 0\.0\d mm by"
    assert re.search(expected, done.out)
    with Image.open(tmp_path / "cameras.png") as picture:
        assert picture.width > 1000
        assert len(picture.convert("RGB").getcolors(1 << 24) or ()) > 1000


def test_cameras_that_are_not_chosen_keep_their_poses(
    command: Command, views: tuple[Path, tuple[CameraModel, ...]], cell: Path
) -> None:
    before = camera_models(LoadScenario(filename=cell))

    done = command("calibrate", "cameras", str(cell), "--views", str(views[0]), "--cameras", "left")

    assert done.status == 0, done.err
    # The poses are complete: a frame in the scenario does not change them.
    text = """{cameras: {left: {X_PB: {base_frame: rack::stand, translation: [0, 0, 0]}}},
      poil: {calibration: out/cameras.yaml}}"""
    left, right = camera_models(LoadScenario(filename=cell, data=text))
    np.testing.assert_allclose(right.X_WC, before[1].X_WC, atol=1e-6)
    assert np.linalg.norm(left.X_WC[:3, 3] - views[1][0].X_WC[:3, 3]) < 1e-3
    assert np.linalg.norm(left.X_WC[:3, 3] - before[0].X_WC[:3, 3]) > 0.01


def test_a_recording_of_a_loose_board_gives_the_poses_between_cameras(
    command: Command, views: tuple[Path, tuple[CameraModel, ...]], tmp_path: Path
) -> None:
    folder, _ = views
    models = camera_models(LoadScenario(filename=default_scenario_file()))
    instants = [
        {camera: view.images[camera] for camera in ("left", "right")}
        for view in load_views(folder, models, on_hand=False)
        for _ in range(2)  # The board rests for two frames.
    ]
    depth = np.ones((480, 640))
    # The recording's poses do not count; these are those of links, which look along x.
    X_WC = make_transform([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [0.5, 0, 1])
    recorded = tuple(replace(model, X_WC=X_WC) for model in models)
    with DemonstrationWriter(tmp_path / "board.mcap", ["left", "right"], {}) as writer:
        for k, images in enumerate(instants):
            writer.write(
                MultiViewFrame(
                    recorded, tuple(RgbdImage(rgb, depth, 0.1 * k) for rgb in images.values())
                )
            )

    with pytest.raises(DemonstrationError, match="is that of a link"):
        load_demonstration(tmp_path / "board.mcap")
    done = command("calibrate", "cameras", "--views", "board.mcap", "--keep", "left")

    assert done.status == 0, done.err
    found = LoadScenario(
        filename=default_scenario_file(), data="{poil: {calibration: out/cameras.yaml}}"
    )
    for camera, true in zip(camera_models(found), models, strict=True):
        assert np.linalg.norm(camera.X_WC[:3, 3] - true.X_WC[:3, 3]) < 1e-3
        assert np.rad2deg(rotation_angle(camera.X_WC[:3, :3].T @ true.X_WC[:3, :3])) < 0.1
    on_hand = command("calibrate", "cameras", "--views", "board.mcap")
    assert "'board.mcap' holds no joint positions" in on_hand.error
    other = "{cameras: {right: {center_x: 310.0}}}"
    done = command(
        "calibrate", "cameras", "--views", "board.mcap", "--keep", "left", "--scenario_text", other
    )
    assert "Camera 'right' in 'board.mcap' has fx, fy, cx, cy" in done.error


def test_no_file_of_the_user_is_overwritten(
    command: Command, views: tuple[Path, tuple[CameraModel, ...]], cell: Path, tmp_path: Path
) -> None:
    notes = tmp_path / "notes.yaml"
    notes.write_text("cameras: on the shelf\n")
    before = cell.read_text()

    for output, problem in ((cell, "overwrite the input"), (notes, "is not a calibration")):
        done = command(
            "calibrate", "cameras", str(cell), "--views", str(views[0]), "-o", str(output)
        )
        assert problem in done.error

    assert (cell.read_text(), notes.read_text()) == (before, "cameras: on the shelf\n")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--cameras", "left,top"], "has no camera 'top'. Choose from: left, right"),
        (["--keep", "top"], "has no camera 'top'"),
        (["--keep", "left", "--cameras", "left"], "Only the camera 'left' takes part"),
        (["--output", "cameras.png"], "Use the suffix .yaml"),
        (["--hardware", "--views", "/dev/null"], "'/dev/null/.*' cannot be written"),
        (
            ["--scenario_text", "{cameras: {right: {focal: !FocalLength {x: 600.0}}}}"],
            "focal length of 46.*px for camera 'right'.*has 600.0 px.*cameras.right.focal",
        ),
        (["--squares", "9x6"], "No image in .* shows the board of 9 x 6 squares"),
        (["--squares", "seven"], "--squares is 'seven', not two numbers such as 7x5"),
        (["--square", "0.036"], "fit squares of 38.0 mm.*36.0 mm.*--square"),
    ],
)
def test_mistakes_end_with_one_line(
    command: Command,
    views: tuple[Path, tuple[CameraModel, ...]],
    arguments: list[str],
    problem: str,
) -> None:
    done = command("calibrate", "cameras", "--views", str(views[0]), *arguments)

    assert done.status != 0
    assert re.search(problem, done.error)
