"""Views of a board, and checks of depth, through the real station from a stand-in's messages."""

from pathlib import Path

import numpy as np
import pytest
from hardware_bench import hardware_scenario, stand_in
from machine_pace import SLOWEST
from textured_board import BOARD, board_scenario, postures, render_views, write_board

from poil_drake.diagrams.calibration.camera_calibration import TakeViews
from poil_drake.diagrams.calibration.camera_check import ExamineCameras
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import CalibrationError, StationError
from poil_drake.perception.calibration.view_folder import load_views


def test_a_view_holds_the_cameras_images_and_the_arms_posture(
    scenario: Scenario, tmp_path: Path
) -> None:
    q = postures(1)
    models = render_views(board_scenario(write_board(tmp_path / "model")), tmp_path / "true", q)
    (truth,) = load_views(tmp_path / "true", models, on_hand=True)
    depth = np.ones((480, 640), np.float32)
    arrays = {f"{name}.rgb": image for name, image in truth.images.items()}
    arrays |= {f"{name}.depth": depth for name in truth.images}
    arrays |= {f"{name}.label": depth.astype(np.int16) for name in truth.images}
    np.savez(tmp_path / "pictures.npz", **arrays)
    cell = hardware_scenario(scenario, time_scale=SLOWEST)
    answers, said = iter([True, True, False]), list[str]()

    with stand_in(cell, tmp_path / "pictures.npz", tmp_path, position=q[0]) as robot:
        taken = TakeViews(
            cell,
            tmp_path / "views",
            BOARD,
            on_hand=True,
            ask=lambda prompt: next(answers),
            say=said.append,
        )
    record = robot.finish()

    assert taken == 2
    assert all(line.startswith("  corners: left ") for line in said)
    for view in load_views(tmp_path / "views", models, on_hand=True):
        np.testing.assert_allclose(view.q, q[0], atol=1e-8)
        for name, image in truth.images.items():
            np.testing.assert_array_equal(view.images[name], image)
    assert record["commanded"] == []
    with pytest.raises(CalibrationError, match="has views already"):
        TakeViews(cell, tmp_path / "views", BOARD, on_hand=True, ask=lambda prompt: False)


def test_the_real_cameras_depth_is_examined_without_commands(
    scenario: Scenario, pictures: Path, tmp_path: Path
) -> None:
    cell = hardware_scenario(scenario, time_scale=SLOWEST)

    with stand_in(cell, pictures, tmp_path) as robot:
        findings = ExamineCameras(cell, hardware=True)
    record = robot.finish()

    assert [finding.name for finding in findings] == ["left", "right", "left and right"]
    assert all(finding.ok for finding in findings)
    assert record["commanded"] == []


def test_a_silent_robot_is_named_although_its_cameras_are_not_needed_yet(
    scenario: Scenario, tmp_path: Path
) -> None:
    cell = hardware_scenario(scenario, ready_timeout=0.05)

    with pytest.raises(StationError, match=r"still missing: the robot's status on PANDA_STATUS"):
        TakeViews(cell, tmp_path, BOARD, on_hand=True, ask=lambda prompt: True)


def test_a_loose_board_needs_no_robot(scenario: Scenario, tmp_path: Path) -> None:
    cell = hardware_scenario(scenario, ready_timeout=0.05)

    with pytest.raises(StationError, match=r"still missing: an image of the camera 'left'"):
        TakeViews(cell, tmp_path / "views", BOARD, on_hand=False, ask=lambda prompt: True)
