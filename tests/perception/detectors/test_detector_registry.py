import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.by_name.config import NamedDetectorConfig, OpenAiServer
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.registry import make_detector, require_detector


@pytest.mark.parametrize("name", ["demonstration", "label_image"])
def test_known_names_are_accepted(name: str) -> None:
    require_detector(name)


def test_detectors_are_made_by_name() -> None:
    assert isinstance(make_detector("label_image"), LabelImageDetector)


def test_detection_by_name_needs_its_configuration() -> None:
    config = NamedDetectorConfig(finder=OpenAiServer())

    with pytest.raises(InvalidValueError, match=r"OpenAiServer\.model is empty"):
        make_detector("by_name", config)


def test_the_detector_of_demonstrations_is_not_made_by_name() -> None:
    with pytest.raises(InvalidValueError, match="'demonstration' knows no names"):
        make_detector("demonstration")


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(InvalidValueError, match="'owl'") as info:
        require_detector("owl")

    assert info.value.remedy == "Choose from: demonstration, by_hand, by_name, label_image."
