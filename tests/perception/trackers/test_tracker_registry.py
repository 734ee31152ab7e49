import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.perception.trackers.registry import TRACKERS
from poil_drake.perception.trackers.registry import make_tracker as dut
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker


def test_makes_the_default_tracker_by_name():
    tracker = dut("rigid_flow")

    assert isinstance(tracker, RigidFlowTracker)
    assert tracker.config == RigidFlowConfig()


def test_passes_the_configuration_on():
    config = RigidFlowConfig(grow=False)

    assert dut("rigid_flow", config).config is config


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(
        InvalidValueError, match=r"'optic_flow'.*Choose from: " + ", ".join(TRACKERS)
    ):
        dut("optic_flow")


def test_another_tracker_s_configuration_is_rejected():
    with pytest.raises(InvalidValueError, match=r"dict.*RigidFlowConfig"):
        dut("rigid_flow", {})
