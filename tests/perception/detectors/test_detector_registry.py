import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.registry import make_detector


def test_detectors_are_made_by_name() -> None:
    assert isinstance(make_detector("label_image"), LabelImageDetector)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(InvalidValueError, match=r"'owl'.*label_image"):
        make_detector("owl")
