"""Part detectors by name."""

from collections.abc import Callable

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import PartDetector

LABEL_IMAGE = "label_image"
"""The detector that reads label images."""

DETECTORS: dict[str, Callable[[], PartDetector]] = {LABEL_IMAGE: LabelImageDetector}
"""Name -> what makes the detector."""


def make_detector(name: str) -> PartDetector:
    """Returns the detector of this name.

    Raises:
        InvalidValueError: if there is none; the message lists the names.
    """
    if name not in DETECTORS:
        raise InvalidValueError(
            f"There is no part detector '{name}'.", remedy=f"Choose from: {', '.join(DETECTORS)}."
        )
    return DETECTORS[name]()
