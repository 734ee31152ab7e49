import pytest

from poil_drake.perception.trackers.lucas_kanade import LucasKanadeConfig, LucasKanadeTracker
from poil_drake.perception.trackers.registry import TRACKERS, TrackerConfigs
from poil_drake.perception.trackers.registry import make_tracker as dut
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker


@pytest.mark.parametrize(
    ("name", "tracker_type", "config", "used"),
    [
        ("rigid_flow", RigidFlowTracker, None, RigidFlowConfig()),
        ("rigid_flow", RigidFlowTracker, RigidFlowConfig(support_points=20), None),
        ("lucas_kanade", LucasKanadeTracker, LucasKanadeConfig(window=15), None),
    ],
)
def test_trackers_are_made_by_name_and_configuration(name, tracker_type, config, used):
    tracker = dut(name, config)

    assert isinstance(tracker, tracker_type)
    assert tracker.config == (used or config)


def test_each_tracker_has_its_own_section_of_the_configuration():
    configs = TrackerConfigs()

    assert {name: type(getattr(configs, name)) for name in TRACKERS} == {
        name: config for name, (_, config) in TRACKERS.items()
    }
