"""Other poses to try when the predicted one leads nowhere."""

from collections.abc import Sequence

import numpy as np

from poil_drake.perception.trackers.object_model import ObjectModel
from poil_drake.perception.trackers.pose_alignment import PoseEstimate, align, move
from poil_drake.perception.trackers.rigid_flow_config import RetryConfig, RigidFlowConfig
from poil_drake.perception.trackers.track_quality import Evidence, examine, glance
from poil_drake.perception.trackers.view_window import ViewWindow


def retry(
    model: ObjectModel,
    windows: Sequence[ViewWindow],
    guesses: Sequence[np.ndarray],
    doubt: np.ndarray,
    config: RigidFlowConfig,
) -> tuple[PoseEstimate, Evidence] | None:
    """Aligns the model from the most promising of many poses.

    Args:
        model: The object.
        windows: The views.
        guesses: Poses (4, 4) around which to try.
        doubt: (6, 6) covariance of how far off the guesses may be.
        config: Parameters.

    Returns:
        The pose that the views bear out best, and that evidence; None where nothing is in view.
    """
    if not windows:
        return None
    motions = _motions(config.retry)
    poses = [move(X, motion) for X in guesses for motion in motions]
    few = model.aligned.select(np.arange(0, len(model.aligned.points), config.retry.stride))
    scores = np.array([glance(few, windows, X, config.quality) for X in poses])
    spread = np.diag(
        np.repeat(np.array([config.retry.angular, config.retry.linear]) ** 2, 3).astype(float)
    )
    best: tuple[PoseEstimate, Evidence] | None = None
    for index in np.argsort(-scores, kind="stable")[: config.retry.aligned]:
        start = PoseEstimate(poses[index], spread, doubt + spread)
        pose = align(model, windows, start, config)
        evidence = examine(model, windows, pose.X_WO, config)
        if best is None or evidence.score > best[1].score:
            best = pose, evidence
    return best


def _motions(config: RetryConfig) -> list[np.ndarray]:
    """Returns the motions (6,) to try: none, and each alone."""
    motions = [np.zeros(6)]
    for sizes, first in ((config.rotations, 0), (config.translations, 3)):
        for size in sizes:
            for axis in range(3):
                for sign in (1.0, -1.0):
                    motion = np.zeros(6)
                    motion[first + axis] = sign * size
                    motions.append(motion)
    return motions
