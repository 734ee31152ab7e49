"""Creates part detectors by name."""

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.by_name.config import NamedDetectorConfig
from poil_drake.perception.detectors.by_name.registry import (
    make_named_detector,
    require_named_detector,
)
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import Detector

LABEL_IMAGE = "label_image"
"""Name of the detector that reads label images."""

DEMONSTRATION = "demonstration"
"""Name of the detector that needs only the demonstration (`find_demonstrated_object`)."""

BY_HAND = "by_hand"
"""Name of the detector that uses what a person has marked with `poil label`."""

BY_NAME = "by_name"
"""Name of the detector that asks a learned model for the words that name object and part."""


def require_detector(name: str, config: NamedDetectorConfig | None = None) -> None:
    """Checks that there is a detector of this name, and that its models are present.

    Args:
        name: The name.
        config: The configuration of the detector `by_name`; None for its defaults.

    Raises:
        InvalidValueError: if no detector has this name, or the configuration is incomplete. The
            error lists the valid names.
        MissingDependencyError: if a library or a model's weights are missing.
    """
    names = (DEMONSTRATION, BY_HAND, BY_NAME, LABEL_IMAGE)
    if name not in names:
        raise InvalidValueError(
            f"There is no part detector '{name}'.", remedy=f"Choose from: {', '.join(names)}."
        )
    if name == BY_NAME:
        require_named_detector(config or NamedDetectorConfig())


def make_detector(
    name: str, config: NamedDetectorConfig | None = None, *, table_height: float | None = None
) -> Detector:
    """Returns a detector that knows objects and parts by their names.

    Args:
        name: `LABEL_IMAGE` or `BY_NAME`.
        config: The configuration of the detector `by_name`; None for its defaults.
        table_height: Height of the plane on which the objects stand [m, world]; None if unknown.

    Raises:
        InvalidValueError: see `require_detector`; also for `DEMONSTRATION` and `BY_HAND`, which
            know no names.
        MissingDependencyError: see `require_detector`.
    """
    require_detector(name, config)
    if name in (DEMONSTRATION, BY_HAND):
        raise InvalidValueError(
            f"The detector '{name}' knows no names.",
            remedy="Use find_demonstrated_object, HandLabelDetector, or another detector.",
        )
    if name == BY_NAME:
        return make_named_detector(config or NamedDetectorConfig(), table_height=table_height)
    return LabelImageDetector()
