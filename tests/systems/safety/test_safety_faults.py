import math

import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.systems.safety import faults as dut


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"status_age_limit": 0.0}, "status_age_limit"),
        ({"tracking_leash": math.nan}, "tracking_leash"),
        ({"image_age_limit": math.inf}, "image_age_limit"),
        ({"external_torque": (1.0,) * 6 + (-1.0,)}, "external_torque"),
        ({"external_torque": ()}, "external_torque"),
        ({"min_success_rate": 1.1}, "min_success_rate"),
    ],
)
def test_settings_are_checked(changes: dict, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        dut.SafetyConfig(**changes)
