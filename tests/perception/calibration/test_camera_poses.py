"""Camera poses from views of a board, against the poses that made the views."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendered_boards import BOARD, X_GB, board_poses, cameras, exact_views
from scipy.spatial.transform import Rotation

from poil_drake.errors import CalibrationError
from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_angle,
    rotation_exp,
)
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.camera_poses import CalibrationResult, calibrate_cameras
from poil_drake.perception.calibration.first_guess import BoardView, robot_world_hand_eye
from poil_drake.perception.images import CameraModel


def errors(result: CalibrationResult, truth: Sequence[CameraModel]) -> tuple[float, float]:
    """Returns the largest errors of the cameras' positions [m] and rotations [rad]."""
    found = [result.cameras[camera.name].X_WC for camera in truth]
    shifts = [np.linalg.norm(X[:3, 3] - c.X_WC[:3, 3]) for X, c in zip(found, truth, strict=True)]
    turns = [
        rotation_angle(X[:3, :3].T @ c.X_WC[:3, :3]) for X, c in zip(found, truth, strict=True)
    ]
    return float(max(shifts)), float(max(turns))


def misplaced(models: Sequence[CameraModel], *kept: str) -> list[CameraModel]:
    """Returns cameras with the same intrinsics at other poses, except those that are kept."""
    return [model if model.name in kept else replace(model, X_WC=np.eye(4)) for model in models]


def calibrate(
    models: Sequence[CameraModel],
    views: Sequence[BoardView],
    poses: np.ndarray,
    kept: str | None = None,
) -> CalibrationResult:
    """Calibrates with a loose board if a camera is kept, else with the board on the hand."""
    hands = None if kept else poses @ inverse(X_GB)
    return calibrate_cameras(models, views, BOARD, hand_poses=hands, kept=kept)


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), count=st.integers(3, 8))
def test_the_closed_form_is_exact_without_noise(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    X_WG = make_transform(Rotation.random(count, rng=rng).as_matrix(), rng.normal(size=(count, 3)))
    board, camera = (
        make_transform(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)) for _ in range(2)
    )

    found = robot_world_hand_eye(X_WG, inverse(camera) @ X_WG @ board)

    np.testing.assert_allclose(found, [board, camera], atol=1e-7)


@pytest.mark.parametrize("names", [("left",), ("left", "right"), ("b", "a", "d", "c")])
def test_a_board_on_the_hand_gives_exact_poses_without_noise(names: tuple[str, ...]) -> None:
    models, poses = cameras(*names), board_poses(12)

    found = calibrate(misplaced(models), exact_views(models, poses), poses)

    assert max(errors(found, models)) < 1e-6
    assert found.square is not None
    for length in (found.square, *(camera.focal_length for camera in found.cameras.values())):
        assert length.found == pytest.approx(length.stated, rel=1e-6)
    assert found.left_out == ()


def test_a_loose_board_connects_cameras_that_share_no_view() -> None:
    models, poses = cameras("left", "middle", "right"), board_poses(12)
    # The cameras at the sides never see the board in the same view.
    unseen = {"left": set(range(6)), "middle": set(), "right": set(range(6, 12))}
    views = [v for v in exact_views(models, poses) if v.view not in unseen[v.camera]]

    found = calibrate(misplaced(models, "left"), views, poses, "left")

    assert max(errors(found, models)) < 1e-6
    np.testing.assert_array_equal(found.cameras["left"].X_WC, models[0].X_WC)
    assert found.cameras["left"].position_error == 0.0


@pytest.mark.parametrize("arm_error", [0.0, 3e-4])
def test_the_standard_errors_are_those_of_repeated_calibrations(arm_error: float) -> None:
    models = cameras("left", "right")
    squares, estimates = [], []
    for seed in range(12):
        poses, rng = board_poses(15, seed=seed), np.random.default_rng(seed)
        turns = rotation_exp(rng.normal(size=(15, 3)) * arm_error)
        wrong = make_transform(turns, rng.normal(size=(15, 3)) * arm_error)
        views = exact_views(models, poses, noise=0.1, seed=seed)
        found = calibrate_cameras(models, views, BOARD, hand_poses=poses @ inverse(X_GB) @ wrong)
        for model in models:
            result = found.cameras[model.name]
            squares.append(np.sum((result.X_WC[:3, 3] - model.X_WC[:3, 3]) ** 2))
            estimates.append(result.position_error**2)

    # 24 squares with 3 degrees of freedom have a relative spread of 2 / sqrt(72), a fourth.
    assert 0.6 < np.sqrt(np.mean(estimates) / np.mean(squares)) < 1.7


def test_a_view_with_the_wrong_joint_positions_is_left_out() -> None:
    models, poses = cameras("left", "right"), board_poses(15)
    hands = poses @ inverse(X_GB)
    hands[4] = hands[5]

    found = calibrate_cameras(
        models, exact_views(models, poses, noise=0.05), BOARD, hand_poses=hands
    )

    assert {(view.camera, view.view) for view in found.left_out} == {("left", 4), ("right", 4)}
    assert errors(found, models)[0] < 1e-3


def test_a_misplaced_corner_has_no_influence() -> None:
    models, poses = cameras("left"), board_poses(12)
    views = exact_views(models, poses)
    pixels = views[3].pixels.copy()
    pixels[7] += [3.0, -2.0]
    views[3] = replace(views[3], pixels=pixels)

    found = calibrate(models, views, poses)

    assert max(errors(found, models)) < 1e-6


def test_a_wrong_size_of_the_squares_is_told_from_the_hands_motions() -> None:
    models, poses = cameras("left", "right"), board_poses(15)
    printed = CalibrationBoard(square=0.0365)

    with pytest.raises(CalibrationError, match=r"fit squares of 38\.0 mm.*squares of 36\.5 mm"):
        calibrate_cameras(
            models,
            exact_views(models, poses, noise=0.1),
            printed,
            hand_poses=poses @ inverse(X_GB),
        )


@pytest.mark.parametrize("kept", [None, "left"])
@pytest.mark.parametrize(("name", "factor"), [("right", 1.015), ("left", 0.98), ("left", 2.0)])
def test_a_wrong_focal_length_is_refused_though_it_reprojects_well(
    kept: str | None, name: str, factor: float
) -> None:
    models, poses = cameras("left", "right"), board_poses(15)
    scale = np.array([[factor, 1.0, 1.0], [1.0, factor, 1.0], [1.0, 1.0, 1.0]])
    wrong = [replace(m, K=m.K * scale) if m.name == name else m for m in models]

    with pytest.raises(CalibrationError, match=rf"56\d\.\d px for camera '{name}', but") as caught:
        calibrate(wrong, exact_views(models, poses, noise=0.1), poses, kept)
    assert f"has {566.0 * factor:.1f} px" in caught.value.problem


@pytest.mark.parametrize("kept", [None, "left"])
@pytest.mark.parametrize("k1", [-0.25, 0.1])
def test_images_with_lens_distortion_are_refused(kept: str | None, k1: float) -> None:
    models, poses = cameras("left", "right"), board_poses(15)
    views, K = exact_views(models, poses, noise=0.1), models[1].K
    for k, view in enumerate(views):
        if view.camera == "right":
            x = (view.pixels - K[:2, 2]) / K[[0, 1], [0, 1]]
            x *= 1.0 + k1 * (x**2).sum(axis=1, keepdims=True)
            views[k] = replace(view, pixels=x * K[[0, 1], [0, 1]] + K[:2, 2])

    with pytest.raises(CalibrationError, match=rf"camera 'right' .* k1 = {k1:.1f}"):
        calibrate(models, views, poses, kept)


def test_a_board_that_slips_is_refused() -> None:
    models, poses = cameras("left", "right"), board_poses(16)
    hands = poses @ inverse(X_GB)
    slipped = make_transform(np.eye(3), np.array([0.03, 0.0, 0.0]))
    hands[8:] = hands[8:] @ slipped

    with pytest.raises(CalibrationError, match=r"do not fit one board.*did not slip"):
        calibrate_cameras(models, exact_views(models, poses), BOARD, hand_poses=hands)


def test_too_few_views_of_one_camera_are_refused_by_its_name() -> None:
    models, poses = cameras("left", "right"), board_poses(12)
    views = [v for v in exact_views(models, poses) if v.camera == "left" or v.view < 5]

    with pytest.raises(CalibrationError, match=r"Camera 'right' sees the board in 5 usable views"):
        calibrate(models, views, poses)


def test_a_hand_that_turns_about_one_axis_is_refused() -> None:
    models, poses = cameras("left"), board_poses(12)
    angles = np.deg2rad(np.linspace(-50.0, 50.0, 12))
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    poses[:, :3, :3] = poses[0, :3, :3] @ turns

    with pytest.raises(CalibrationError, match=r"31 degrees \(RMS\) about one axis, 0 about"):
        calibrate(models, exact_views(models, poses), poses)


def test_cameras_that_nothing_connects_are_refused() -> None:
    models, poses = cameras("left", "right", "far", "near"), board_poses(8)
    pairs = ({"left", "right"}, {"far", "near"})
    views = [v for v in exact_views(models, poses) if v.camera in pairs[v.view // 4]]

    with pytest.raises(CalibrationError, match=r"No view connects camera 'far' with left"):
        calibrate(models, views, poses, "left")
