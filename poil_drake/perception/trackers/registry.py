"""Creates point trackers by name."""

from collections.abc import Callable
from typing import Any

from poil_drake.errors import InvalidValueError
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

    Raises:
        InvalidValueError: if no tracker has this name, or `config` is not of its type.
    """
    if name not in TRACKERS:
        raise InvalidValueError(
            f"There is no point tracker '{name}'.", remedy=f"Choose from: {', '.join(TRACKERS)}."
        )
    constructor, config_type = TRACKERS[name]
    if config is not None and not isinstance(config, config_type):
        raise InvalidValueError(
            f"The tracker '{name}' got a configuration of type {type(config).__name__}.",
            remedy=f"Pass a {config_type.__name__}, or None for the defaults.",
        )
    return constructor(config)
