"""A dry run on hardware: perception and control run, but nothing is sent to the robot.

Here, `poil driver` simulates the robot in a separate process, behind the real interface (LCM).
With a real robot, start no driver here. Needs a plan from `poil transfer`:
python examples/hardware_dry_run.py out/plan.npz out/dry_run
"""

import subprocess
import sys
from pathlib import Path

import poil_drake as poil

scenario_file = sys.argv[3] if len(sys.argv) > 3 else poil.default_scenario_file()
scenario = poil.LoadScenario(filename=scenario_file)
plan = poil.ExecutionPlan.load(sys.argv[1])
outputs = poil.OutputPaths.under(Path(sys.argv[2]))
driver = subprocess.Popen([sys.executable, "-m", "poil_drake", "driver", str(scenario_file)])
try:
    summary = poil.ExecutePlan(
        plan, scenario, outputs=outputs, hardware=True, dry_run=True, show=False
    )
finally:
    driver.terminate()
    driver.wait()
print(summary.closing_line())
