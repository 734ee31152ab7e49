"""Creates point trackers by name."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from poil_drake.perception.trackers.learned.co_tracker3 import CoTracker3
from poil_drake.perception.trackers.learned.config import CoTracker3Config, MvTrackerConfig
from poil_drake.perception.trackers.learned.mv_tracker import MvTracker
from poil_drake.perception.trackers.lucas_kanade import LucasKanadeConfig, LucasKanadeTracker
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker

TRACKERS: dict[str, tuple[Callable[[Any], Tracker], type]] = {
    "rigid_flow": (RigidFlowTracker, RigidFlowConfig),
    "lucas_kanade": (LucasKanadeTracker, LucasKanadeConfig),
    "mvtracker": (MvTracker, MvTrackerConfig),
    "cotracker3": (CoTracker3, CoTracker3Config),
}
"""Constructor and configuration type of each tracker, by name."""


@dataclass(frozen=True, kw_only=True)
class TrackerConfigs:
    """Parameters of all trackers, by their names in `TRACKERS`, so that any can be chosen later.

    Attributes:
        rigid_flow: The default tracker's.
        lucas_kanade: Those of the Lucas-Kanade tracker, a baseline.
        mvtracker: Those of MVTracker, and where it is installed.
        cotracker3: Those of CoTracker3, and where it is installed.
    """

    rigid_flow: RigidFlowConfig = field(default_factory=RigidFlowConfig)
    lucas_kanade: LucasKanadeConfig = field(default_factory=LucasKanadeConfig)
    mvtracker: MvTrackerConfig = field(default_factory=MvTrackerConfig)
    cotracker3: CoTracker3Config = field(default_factory=CoTracker3Config)


def make_tracker(name: str, config: object | None = None) -> Tracker:
    """Returns a new tracker of this name.

    Args:
        name: One of `TRACKERS`.
        config: The tracker's own parameters, e.g. a `RigidFlowConfig`; None for its defaults.

    Raises:
        MissingDependencyError: if the tracker needs weights or an environment that are missing.
    """
    constructor, _ = TRACKERS[name]
    return constructor(config)
