import pytest

from poil_drake.perception.trackers.registry import make_tracker as dut
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker


@pytest.mark.parametrize("config", [None, RigidFlowConfig(support_points=20)])
def test_trackers_are_made_by_name_and_configuration(config):
    tracker = dut("rigid_flow", config)

    assert isinstance(tracker, RigidFlowTracker)
    assert tracker.config == (config or RigidFlowConfig())
