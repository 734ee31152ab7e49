"""Compares the cameras of a replay with those of the run."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.perception.images import CameraModel
from poil_drake.recording.run_log.recorded_run import RecordedRun

_SAME_LENGTH = 1e-5
"""Positions closer than this [m] count as equal: far below any calibration error."""

_SAME_ANGLE = 1e-5
"""Rotations smaller than this [rad] are ignored: they move a point at ten metres by 0.1 mm."""

_SAME_PIXELS = 1e-3
"""Focal lengths and principal points closer than this [px] count as equal."""


def CameraNotes(run: RecordedRun, models: Sequence[CameraModel]) -> tuple[str, ...]:
    """Returns remarks on the cameras whose intrinsics or poses differ from the log's.

    Each remark is a clause about one camera. Cameras missing from the log are skipped.

    Args:
        run: The recorded run.
        models: The cameras of the replay.
    """
    notes = []
    for model in models:
        if differences := (*_intrinsics(run, model), *_pose(run, model)):
            notes.append(f"in the run, camera '{model.name}' {' and '.join(differences)}")
    return tuple(notes)


def _intrinsics(run: RecordedRun, model: CameraModel) -> tuple[str, ...]:
    found = run.calibrations.get(model.name)
    if found is None:
        return ()
    if (found.width, found.height) != (model.width, model.height):
        return (f"had {found.width} x {found.height} pixels",)
    largest = float(np.abs(found.K - model.K).max())
    return (f"had intrinsics that differ by {largest:.2g} px",) if largest > _SAME_PIXELS else ()


def _pose(run: RecordedRun, model: CameraModel) -> tuple[str, ...]:
    X_WC = run.camera_poses.get(model.name)
    if X_WC is None:
        return ()
    differences = []
    distance = float(np.linalg.norm(X_WC[:3, 3] - model.X_WC[:3, 3]))
    if distance > _SAME_LENGTH:
        differences.append(f"was {1e3 * distance:.2g} mm from its present position")
    angle = Rotation.from_matrix(X_WC[:3, :3].T @ model.X_WC[:3, :3]).magnitude()
    if angle > _SAME_ANGLE:
        differences.append(f"was rotated by {np.rad2deg(angle):.2g} deg")
    return tuple(differences)
