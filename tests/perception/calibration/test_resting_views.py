import numpy as np
from rendered_boards import BOARD, board_poses, cameras, rendered

from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.perception.calibration.resting_views import resting_views
from poil_drake.perception.images import MultiViewFrame, RgbdImage


def test_only_frames_in_which_the_board_rests_are_views() -> None:
    models, (first, second) = cameras("left", "right"), board_poses(2)
    step = make_transform(np.eye(3), np.array([0.004, 0.0, 0.0]))
    # It moves, rests for three frames, moves, rests for two, and moves.
    poses = [step @ step @ first, first, first, first, step @ first, second, second, step @ second]
    pictures = [[rendered(m, X, seed=k) for m in models] for k, X in enumerate(poses)]
    frames = [
        MultiViewFrame(models, tuple(RgbdImage(rgb, np.ones((480, 640)), k / 8) for rgb in views))
        for k, views in enumerate(pictures)
    ]

    found = resting_views(frames, BOARD)

    assert [view.name for view in found] == ["00", "01"]
    for view, expected in zip(found, (pictures[2], pictures[6]), strict=True):
        for model, image in zip(models, expected, strict=True):
            np.testing.assert_array_equal(view.images[model.name], image)


def test_frames_without_a_board_are_no_views() -> None:
    (model,) = cameras("left")
    image = RgbdImage(np.full((480, 640, 3), 90, np.uint8), np.ones((480, 640)), 0.0)

    assert resting_views([MultiViewFrame((model,), (image,))] * 3, BOARD) == []
