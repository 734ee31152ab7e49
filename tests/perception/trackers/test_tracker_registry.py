import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.perception.trackers.registry import TRACKERS
from poil_drake.perception.trackers.registry import make_tracker as dut
from poil_drake.perception.trackers.rigid_flow.config import GrowthConfig, RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker


def test_makes_the_default_tracker_by_name():
    tracker = dut("rigid_flow")

    assert isinstance(tracker, RigidFlowTracker)
    assert tracker.config == RigidFlowConfig()


def test_passes_the_configuration_on():
    config = RigidFlowConfig(growth=GrowthConfig(enabled=False))

    assert dut("rigid_flow", config).config is config


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(
        InvalidValueError, match=r"'optic_flow'.*Choose from: " + ", ".join(TRACKERS)
    ):
        dut("optic_flow")


def test_another_tracker_s_configuration_is_refused():
    with pytest.raises(InvalidValueError, match=r"GrowthConfig.*RigidFlowConfig"):
        dut("rigid_flow", GrowthConfig())


def test_schedules_must_be_of_one_length():
    from poil_drake.perception.trackers.rigid_flow.alignment.config import DepthConfig

    with pytest.raises(InvalidValueError, match=r"depth\.gates"):
        RigidFlowConfig(depth=DepthConfig(gates=(0.02, 0.01)))
