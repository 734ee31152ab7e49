import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.registry import DETECTORS, require_detector


@pytest.mark.parametrize("name", ["demonstration", "label_image"])
def test_known_names_are_accepted(name: str) -> None:
    require_detector(name)


def test_detectors_that_know_names_are_made_by_name() -> None:
    assert isinstance(DETECTORS["label_image"](), LabelImageDetector)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(InvalidValueError, match=r"'owl'.*") as info:
        require_detector("owl")

    assert info.value.remedy == "Choose from: demonstration, label_image."
