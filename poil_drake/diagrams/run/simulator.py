"""The simulator of a run, as the scenario wants it."""

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Diagram

from poil_drake.diagrams.scenario.scenario import Scenario


def MakeSimulator(
    diagram: Diagram, scenario: Scenario, *, realtime_rate: float | None = None
) -> Simulator:
    """Returns a simulator with the scenario's `simulator_config`.

    Args:
        diagram: What to simulate.
        scenario: The scenario.
        realtime_rate: In place of its `target_realtime_rate`; 0 runs as fast as it can.
    """
    simulator = Simulator(diagram)
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    if realtime_rate is not None:
        simulator.set_target_realtime_rate(realtime_rate)
    return simulator
