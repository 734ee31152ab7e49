"""Compares the cameras of a replay with those of the run."""

from collections.abc import Iterator, Sequence

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
    """Returns remarks on the cameras whose intrinsics or poses differ between run and replay.

    Each remark is a clause about one camera. Cameras missing from the log are skipped.

    Args:
        run: The recorded run.
        models: The cameras of the replay.
    """
    found = {model.name: " and ".join(_differences(run, model)) for model in models}
    return tuple(f"in the run, camera '{name}' {text}" for name, text in found.items() if text)


def _differences(run: RecordedRun, model: CameraModel) -> Iterator[str]:
    if (found := run.calibrations.get(model.name)) is not None:
        if (found.width, found.height) != (model.width, model.height):
            yield f"had {found.width} x {found.height} pixels"
        elif (largest := np.abs(found.K - model.K).max()) > _SAME_PIXELS:
            yield f"had intrinsics that differ by {largest:.2g} px from the replay's"
    if (X_WC := run.camera_poses.get(model.name)) is not None:
        distance = np.linalg.norm(X_WC[:3, 3] - model.X_WC[:3, 3])
        if distance > _SAME_LENGTH:
            yield f"was {1e3 * distance:.2g} mm from its position in the replay"
        angle = Rotation.from_matrix(X_WC[:3, :3].T @ model.X_WC[:3, :3]).magnitude()
        if angle > _SAME_ANGLE:
            yield f"was rotated by {np.rad2deg(angle):.2g} deg relative to the replay"
