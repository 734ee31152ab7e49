"""Calibrates a scenario's cameras from views of a board."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from poil_drake.diagrams.calibration.calibration_file import WriteCalibration
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.cameras import MakeCameraModels
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.errors import CalibrationError, ScenarioError
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.camera_poses import CalibrationResult, calibrate_cameras
from poil_drake.perception.calibration.first_guess import BoardView
from poil_drake.perception.calibration.resting_views import resting_views
from poil_drake.perception.calibration.view_folder import (
    POSITIONS_FILE,
    View,
    load_views,
    save_view,
)
from poil_drake.perception.capture.checks import check_same_view
from poil_drake.perception.images import CameraModel
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.reports.calibration_picture import calibration_picture
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.output_files import require_writable

_STILL = 1e-3
"""Largest motion of a joint while a view is taken [rad]: 1 mm at the hand."""


def _choose_cameras(scenario: Scenario, names: Sequence[str], kept: str | None) -> tuple[str, ...]:
    """Returns the names of the cameras that take part, including the kept one."""
    wanted = {*(names or scenario.cameras), *([] if kept is None else [kept])}
    if not wanted:
        raise ScenarioError("The scenario has no cameras.", remedy="Define them under 'cameras'.")
    if unknown := wanted - scenario.cameras.keys():
        raise ScenarioError(
            f"The scenario has no camera '{min(unknown)}'.",
            remedy=f"Choose from: {', '.join(scenario.cameras)}.",
        )
    if kept is not None and len(wanted) < 2:
        raise ScenarioError(
            f"Only the camera '{kept}' takes part, but a loose board gives poses between cameras.",
            remedy="Choose another one as well, or fix the board to the hand.",
        )
    return tuple(name for name in scenario.cameras if name in wanted)


def TakeViews(
    scenario: Scenario,
    folder: Path,
    board: CalibrationBoard,
    *,
    cameras: Sequence[str] = (),
    kept: str | None = None,
    ask: Callable[[str], bool],
) -> None:
    """Takes views of a board with a scenario's real cameras, and adds them to a folder.

    Nothing is sent to the robot. A view is saved at once, if at least one camera sees the board.
    Prints a line for each view.

    Args:
        scenario: Describes the cameras and the robot's network.
        folder: The folder.
        board: The board.
        cameras: Names of the cameras that take views; empty for all.
        kept: For a loose board, another one; None for a board on the hand, for which the robot's
            joint positions are needed.
        ask: Waits until the user wants the next view; returns False to end. Called with a prompt.

    Raises:
        PoilError: if a camera or the robot sends nothing, or the folder cannot be written.
    """
    chosen = _choose_cameras(scenario, cameras, kept)
    require_writable(folder / POSITIONS_FILE)
    names = {path.stem.partition("_")[0] for path in folder.glob("*_*.png")}
    if names:
        print(
            f"'{folder}' has {len(names)} views, to which new ones are added; remove them if the "
            "cameras, or the board on the hand, have moved since"
        )
    number = max((int(name) + 1 for name in names if name.isdecimal()), default=0)
    # No `with` block: that would wait until the robot can be commanded, but a person moves it.
    station = MakeStation(_with_cameras(scenario, chosen), hardware=True, dry_run=True)
    try:
        station.Start()
        context = station.CreateDefaultContext()
        while ask(f"view {number:02d}: Enter takes it, q ends"):
            q = station.ArmPosition(context) if kept is None else None
            taken = station.TakeImages(context)
            if q is not None and np.abs(station.ArmPosition(context) - q).max() > _STILL:
                print("  not taken: the arm moves")
                continue
            images = dict(zip(station.camera_names, (i.rgb for i in taken), strict=True))
            found = {name: board.detect(image) for name, image in images.items()}
            counts = {name: 0 if c is None else len(c[0]) for name, c in found.items()}
            seen = ", ".join(f"{name} {n} of {len(board.corners)}" for name, n in counts.items())
            if not any(counts.values()):
                print("  not taken: no camera sees the board")
                continue
            save_view(folder, View(f"{number:02d}", images, q))
            number += 1
            print(f"  corners: {seen}")
    finally:
        station.Close()


def _with_cameras(scenario: Scenario, names: Sequence[str]) -> Scenario:
    """Returns a scenario with these cameras only."""
    hardware = scenario.poil.hardware
    sources = {name: source for name, source in hardware.cameras.items() if name in names}
    poil = replace(scenario.poil, hardware=replace(hardware, cameras=sources))
    return replace(scenario, cameras={n: scenario.cameras[n] for n in names}, poil=poil)


def CalibrateCameras(
    scenario: Scenario,
    views: Path,
    board: CalibrationBoard,
    *,
    cameras: Sequence[str] = (),
    kept: str | None = None,
    output: Path,
    picture: Path,
) -> CalibrationResult:
    """Calibrates cameras from the views in a folder, and writes their poses and a picture.

    Args:
        scenario: The cameras with their intrinsics, and the pose of the robot's base.
        views: A folder of views, see `load_views`; or, for a loose board, a demonstration's file
            (.mcap), of which the frames count in which the board rests.
        board: The board.
        cameras: Names of the cameras to calibrate; empty for all.
        kept: For a loose board, the camera whose pose is kept; None for a board on the hand.
        output: File for the poses, for the scenario key `poil.calibration`.
        picture: PNG file for a picture of the detected corners and their errors.

    Raises:
        PoilError: if the scenario or the views are unusable.
    """
    names = _choose_cameras(scenario, cameras, kept)
    station = MakeStation(scenario, cameras=False)
    everything = MakeCameraModels(station.plant(), scenario.cameras)
    chosen = [model for model in everything if model.name in names]
    loaded = _load(views, chosen, board, on_hand=kept is None)
    found = [
        BoardView(model.name, number, *corners, name=f"{view.name}_{model.name}")
        for number, view in enumerate(loaded)
        for model in chosen
        if model.name in view.images
        and (corners := board.detect(view.images[model.name])) is not None
    ]
    if not found:
        raise CalibrationError(
            f"No image in '{views}' shows the board of {board.columns} x {board.rows} squares "
            f"with markers of the dictionary {board.dictionary}.",
            remedy="State the board that was used with --squares and --dictionary, or print the "
            "board of `poil calibrate board`; it must be well lit, sharp and not too small.",
        )
    hand_poses = None
    if kept is None:
        arm = PandaModel(X_WB=station.robot_base_pose().GetAsMatrix4())
        hand_poses = arm.gripper_pose(np.stack([view.q for view in loaded if view.q is not None]))
    result = calibrate_cameras(chosen, found, board, hand_poses=hand_poses, kept=kept)
    WriteCalibration(output, scenario, everything, result)
    calibration_picture(picture, chosen, loaded, found, board, result)
    return result


def _load(
    path: Path, cameras: Sequence[CameraModel], board: CalibrationBoard, *, on_hand: bool
) -> list[View]:
    if path.is_dir() or path.suffix != ".mcap":
        return load_views(path, cameras, on_hand=on_hand)
    if on_hand:
        raise CalibrationError(
            f"'{path}' holds no joint positions, which are needed if the hand holds the board.",
            remedy="Take views with --hardware; or, if the board was loose, name the camera whose "
            "pose is right with --keep.",
        )
    names = [camera.name for camera in cameras]
    recording = load_demonstration(path, cameras=names, plausible=False)
    for recorded, camera in zip(recording.cameras, cameras, strict=True):
        check_same_view(recorded, camera, source=f"Camera '{camera.name}' in '{path}'")
    return resting_views(recording.frames, board)
