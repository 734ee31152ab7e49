"""Views of a board, and checks of depth, through the real station from a stand-in's messages."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hardware_bench import hardware_scenario, stand_in
from machine_pace import SLOWEST
from textured_board import BOARD, board_scenario, postures, render_views, write_board

from poil_drake.diagrams.calibration.camera_calibration import TakeViews
from poil_drake.diagrams.calibration.camera_check import ExamineCameras
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import StationError
from poil_drake.perception.calibration.view_folder import load_views


def test_a_view_holds_the_cameras_images_and_the_arms_posture(
    scenario: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
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

    def take(*answers: bool) -> None:
        rest = iter(answers)
        TakeViews(cell, tmp_path / "views", BOARD, ask=lambda prompt: next(rest))

    with stand_in(cell, tmp_path / "pictures.npz", tmp_path, position=q[0]) as robot:
        take(True, True, False)
        take(True, False)
    record = robot.finish()

    said = capsys.readouterr().out
    assert said.count("  corners: left ") == 3
    assert said.count("has 2 views, to which new ones are added") == 1
    views = load_views(tmp_path / "views", models, on_hand=True)
    assert [view.name for view in views] == ["00", "01", "02"]
    for view in views:
        np.testing.assert_allclose(view.q, q[0], atol=1e-8)
        for name, image in truth.images.items():
            np.testing.assert_array_equal(view.images[name], image)
    assert record["commanded"] == []


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


@pytest.mark.parametrize(
    ("kept", "missing"),
    [
        (None, "the robot's status on PANDA_STATUS"),
        # A loose board needs no robot, and a camera that takes no part is not waited for.
        ("left", r"an image of the camera 'left', an image of the camera 'right'\. "),
    ],
)
def test_what_sends_nothing_is_named(
    scenario: Scenario, tmp_path: Path, kept: str | None, missing: str
) -> None:
    third = replace(scenario, cameras={**scenario.cameras, "top": scenario.cameras["left"]})
    cell = hardware_scenario(third, ready_timeout=0.05)

    with pytest.raises(StationError, match=f"still missing: {missing}"):
        TakeViews(cell, tmp_path, BOARD, cameras=["right"], kept=kept, ask=lambda prompt: True)
