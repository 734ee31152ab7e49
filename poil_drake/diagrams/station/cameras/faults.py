"""The faults of a simulated station's cameras."""

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.perception.faults.extrinsics import ExtrinsicsError
from poil_drake.perception.faults.injector import FaultInjector, check_cameras


def MakeFaultInjector(scenario: Scenario) -> FaultInjector:
    """Returns an injector of the scenario's faults into a new stream of images."""
    poil = scenario.poil
    return FaultInjector(poil.faults, object_label=poil.object, seed=scenario.random_seed)


def CheckFaults(scenario: Scenario, *, delayed: bool) -> None:
    """Checks that the scenario's cameras can have its faults.

    Args:
        scenario: Has the faults and the cameras.
        delayed: Whether the cameras have a delay, or no run reads their ports.

    Raises:
        InvalidValueError: if a fault names an unknown camera.
        ScenarioError: if anything but the calibration is faulty, and `delayed` is False.
    """
    faults = scenario.poil.faults
    check_cameras(faults, list(scenario.cameras))
    if not delayed and any(not isinstance(fault, ExtrinsicsError) for fault in faults):
        raise ScenarioError(
            "poil.faults needs cameras with an output_delay: without one, images are read where "
            "they are rendered, and nothing can change them.",
            remedy="Set the cameras' output_delay to a positive time, or remove poil.faults.",
        )
