"""The tracker that a scenario selects."""

from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH
from poil_drake.errors import InvalidValueError
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.perception.trackers.registry import TRACKERS, make_tracker
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig

DEFAULT_TRACKER = "rigid_flow"
"""The tracker for demonstrations if `poil.tracker` is the ground-truth baseline."""


def MakeScenarioTracker(poil: PoilConfig) -> Tracker:
    """Returns the image-based tracker that a scenario selects.

    For the ground-truth baseline, which uses no images, returns the tracker `DEFAULT_TRACKER`.

    Raises:
        InvalidValueError: if `poil.tracker` is not a known name.
    """
    name = DEFAULT_TRACKER if poil.tracker == GROUND_TRUTH else poil.tracker
    if name not in TRACKERS:
        raise InvalidValueError(
            f"There is no point tracker '{name}'.",
            remedy=f"Choose one of: {', '.join([*TRACKERS, GROUND_TRUTH])}.",
        )
    if TRACKERS[name][1] is RigidFlowConfig:
        return make_tracker(name, RigidFlowConfig(support_points=poil.num_support_points))
    return make_tracker(name)
