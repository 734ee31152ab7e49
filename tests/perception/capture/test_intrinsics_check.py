import numpy as np
import pytest
from capture_bench import CAMERA, K

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import CaptureError
from poil_drake.perception.capture.intrinsics_check import check_intrinsics


def test_intrinsics_within_a_pixel_are_accepted() -> None:
    check_intrinsics(K + np.diag([0.9, -0.9, 0.0]), CAMERA, source="It")


@pytest.mark.parametrize(("row", "column"), [(0, 0), (1, 1), (0, 2), (1, 2)])
def test_an_error_names_intrinsics_that_differ(row: int, column: int) -> None:
    found = K.copy()
    found[row, column] += 1.25
    text = ", ".join(f"{found[index]:.2f}" for index in ((0, 0), (1, 1), (0, 2), (1, 2)))

    with pytest.raises(CaptureError) as said:
        check_intrinsics(found, CAMERA, source="It")

    assert f"It has fx, fy, cx, cy = {text} px" in str(said.value)
    assert "the scenario has 20.00, 20.00, 3.50, 2.50 px" in str(said.value)


def test_a_scenario_accepts_the_text_of_the_remedy() -> None:
    found = np.array([[600.25, 0.0, 321.5], [0.0, 601.5, 240.75], [0.0, 0.0, 1.0]])
    with pytest.raises(CaptureError) as said:
        check_intrinsics(found, CAMERA, source="It")

    text = said.value.remedy.split(": ", 1)[1]
    config = ChooseScenario(data=f"{{{text}}}").cameras["left"]

    core = config.MakeCameras()[0].core()
    np.testing.assert_allclose(core.intrinsics().intrinsic_matrix(), found)
