from pathlib import Path

import numpy as np
import pytest

from poil_drake.diagrams.replay.replay import CameraNotes
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.perception.images import CameraModel
from poil_drake.recording.mcap.message_decoders import Calibration
from poil_drake.recording.run_log.recorded_run import RecordedRun

K = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
TURNED = np.array([[np.cos(0.01), -np.sin(0.01), 0], [np.sin(0.01), np.cos(0.01), 0], [0, 0, 1]])


def run_with(K=K, size=(640, 480), X_WC=None):
    """A run whose camera "left" was at the origin, or elsewhere."""
    return RecordedRun(
        Path("run.mcap"),
        (),
        calibrations={"left": Calibration("left", *size, K, np.zeros(0))},
        camera_poses={"left": np.eye(4) if X_WC is None else X_WC},
    )


@pytest.mark.parametrize(
    ("run", "notes"),
    [
        (run_with(), ()),
        # Rounding.
        (run_with(X_WC=make_transform(np.eye(3), [1e-12, 0.0, 0.0])), ()),
        (
            run_with(X_WC=make_transform(np.eye(3), [0.0, 0.023, 0.0])),
            ("in the run, camera 'left' was 23 mm from its position in the replay",),
        ),
        # 0.01 rad.
        (
            run_with(X_WC=make_transform(TURNED, [0.0, 0.0, 0.0])),
            ("in the run, camera 'left' was rotated by 0.57 deg relative to the replay",),
        ),
        (
            run_with(K=K + np.diag([2.0, 2.0, 0.0]), X_WC=make_transform(TURNED, [0.0, 0.0, 0.5])),
            (
                "in the run, camera 'left' had intrinsics that differ by 2 px from the replay's "
                "and was 5e+02 mm from its position in the replay "
                "and was rotated by 0.57 deg relative to the replay",
            ),
        ),
        (run_with(size=(320, 240)), ("in the run, camera 'left' had 320 x 240 pixels",)),
        (RecordedRun(Path("run.mcap"), ()), ()),
    ],
)
def test_cameras_that_differ_are_noted(run, notes):
    models = [CameraModel(name, 640, 480, K, np.eye(4)) for name in ("left", "right")]

    assert CameraNotes(run, models) == notes
