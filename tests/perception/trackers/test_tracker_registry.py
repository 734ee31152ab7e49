import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.perception.trackers.registry import TRACKERS
from poil_drake.perception.trackers.registry import make_tracker as dut
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker


@pytest.mark.parametrize("config", [None, RigidFlowConfig(support_points=20)])
def test_trackers_are_made_by_name_and_configuration(config):
    tracker = dut("rigid_flow", config)

    assert isinstance(tracker, RigidFlowTracker)
    assert tracker.config == (config or RigidFlowConfig())


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(
        InvalidValueError, match=r"'optic_flow'.*Choose from: " + ", ".join(TRACKERS)
    ):
        dut("optic_flow")


def test_another_tracker_s_configuration_is_rejected():
    with pytest.raises(InvalidValueError, match=r"dict.*RigidFlowConfig"):
        dut("rigid_flow", {})
