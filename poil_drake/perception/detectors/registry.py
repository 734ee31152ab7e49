"""Creates part detectors by name."""

from collections.abc import Callable

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import Detector

LABEL_IMAGE = "label_image"
"""Name of the detector that reads label images."""

DETECTORS: dict[str, Callable[[], Detector]] = {LABEL_IMAGE: LabelImageDetector}
"""Constructors of the detectors, by name."""


def make_detector(name: str) -> Detector:
    """Returns a new detector of this name.

    Raises:
        InvalidValueError: if no detector has this name. The error lists the valid names.
    """
    if name not in DETECTORS:
        raise InvalidValueError(
            f"There is no part detector '{name}'.", remedy=f"Choose from: {', '.join(DETECTORS)}."
        )
    return DETECTORS[name]()
