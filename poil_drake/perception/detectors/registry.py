"""Creates part detectors by name."""

from collections.abc import Callable

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import Detector

LABEL_IMAGE = "label_image"
"""Name of the detector that reads label images."""

DEMONSTRATION = "demonstration"
"""Name of the detector that needs only the demonstration (`find_demonstrated_object`)."""

DETECTORS: dict[str, Callable[[], Detector]] = {LABEL_IMAGE: LabelImageDetector}
"""Constructors of the detectors that know objects and parts by their names."""


def require_detector(name: str) -> None:
    """Checks that there is a detector of this name.

    Raises:
        InvalidValueError: if no detector has this name. The error lists the valid names.
    """
    names = (DEMONSTRATION, *DETECTORS)
    if name not in names:
        raise InvalidValueError(
            f"There is no part detector '{name}'.", remedy=f"Choose from: {', '.join(names)}."
        )
