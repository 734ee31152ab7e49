"""Hangs a mug in closed loop: the diagram of the README."""

from pathlib import Path

from pydrake.systems.analysis import Simulator

from poil_drake.diagrams.demonstration.recorder import RecordDemonstration
from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.run.html_recording import MakeMeshcat
from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.scenario.load import LoadScenario, default_scenario_file

scenario = LoadScenario(filename=default_scenario_file())
demonstration = Path("out/demo.mcap")
RecordDemonstration(scenario, demonstration)
plan = PlanScenario(scenario, demonstration)
meshcat = MakeMeshcat()
print(meshcat.web_url())
with MakeClosedLoop(scenario, plan, meshcat=meshcat) as loop:
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(16.0)
