"""Hangs a mug in closed loop: the diagram of the README."""

from pathlib import Path

from pydrake.systems.analysis import Simulator

import poil_drake as poil

scenario = poil.LoadScenario(filename=poil.default_scenario_file())
demonstration = Path("out/demo.mcap")
poil.RecordDemonstration(scenario, demonstration)
plan = poil.PlanScenario(scenario, demonstration)
meshcat = poil.MakeMeshcat()
print(meshcat.web_url())
with poil.MakeClosedLoop(scenario, plan, meshcat=meshcat) as loop:
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(16.0)
