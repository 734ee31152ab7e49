"""Creates point trackers by name."""

from collections.abc import Callable
from typing import Any

from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker

TRACKERS: dict[str, tuple[Callable[[Any], Tracker], type]] = {
    "rigid_flow": (RigidFlowTracker, RigidFlowConfig),
}
"""Constructor and configuration type of each tracker, by name."""


def make_tracker(name: str, config: object | None = None) -> Tracker:
    """Returns a new tracker of this name.

    Args:
        name: One of `TRACKERS`.
        config: The tracker's own parameters, e.g. a `RigidFlowConfig`; None for its defaults.
    """
    constructor, _ = TRACKERS[name]
    return constructor(config)
