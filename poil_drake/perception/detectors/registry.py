"""Creates part detectors by name."""

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.by_name.config import NamedDetectorConfig
from poil_drake.perception.detectors.by_name.registry import make_named_detector
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import Detector

LABEL_IMAGE = "label_image"
"""Name of the detector that reads label images."""

BY_NAME = "by_name"
"""Name of the detector that asks a learned model for what the object and the part are called."""

DETECTORS = (LABEL_IMAGE, BY_NAME)
"""Names of the detectors."""


def make_detector(
    name: str,
    config: NamedDetectorConfig | None = None,
    *,
    table_height: float | None = None,
) -> Detector:
    """Returns a detector of this name.

    Args:
        name: One of `DETECTORS`.
        config: The configuration of `by_name`; None for its defaults. Other detectors have none.
        table_height: Height of the plane on which the objects stand [m, world]; None if unknown.

    Raises:
        InvalidValueError: if no detector has this name, or the configuration is incomplete.
        MissingDependencyError: if a library or a model's weights are missing.
    """
    if name not in DETECTORS:
        raise InvalidValueError(
            f"There is no part detector '{name}'.", remedy=f"Choose from: {', '.join(DETECTORS)}."
        )
    if name == BY_NAME:
        return make_named_detector(config or NamedDetectorConfig(), table_height=table_height)
    return LabelImageDetector()
