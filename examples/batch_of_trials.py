"""Trials side by side: pushes of different force on the arm, each in a worker process.

Needs a plan from `poil transfer`:
python examples/batch_of_trials.py out/plan.npz 0 10 20
"""

import sys

from pydrake.systems.analysis import Simulator

import poil_drake as poil
from poil_drake.benchmarks import LostTrial, run_trials
from poil_drake.systems import Pulse


def push(plan_file: str, force: float) -> float:
    """Pushes with `force` [N] near the goal; returns the points' distance from the goal [m]."""
    scenario = poil.LoadScenario(
        filename=poil.default_scenario_file(), data="{poil: {tracker: ground_truth}}"
    )
    pulse = Pulse(body="panda::panda_link7", start=10.1, duration=0.3, force=(0.0, force, 0.0))
    plan = poil.ExecutionPlan.load(plan_file)
    with poil.MakeClosedLoop(scenario, plan, disturbances=[pulse]) as loop:
        simulator = Simulator(loop.diagram)
        simulator.AdvanceTo(10.25)  # When the push is strongest.
        context = loop.controller.GetMyContextFromRoot(simulator.get_context())
        return float(loop.controller.GetOutputPort("goal_error").Eval(context)[0])


# Each worker imports this file.
if __name__ == "__main__":
    plan_file, forces = sys.argv[1], [float(force) for force in sys.argv[2:]]
    trials = run_trials(push, [(force,) for force in forces], shared=(plan_file,), jobs=2)
    for index, result in trials:
        said = str(result) if isinstance(result, LostTrial) else f"{1000 * result:.1f} mm"
        print(f"{forces[index]:4.0f} N: {said}")
