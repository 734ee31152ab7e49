"""Your own task: another mug, the rack turned and moved, and a demonstration in this scene.

Writes the files of `poil run` to the given folder: python examples/own_task.py out/own
"""

import sys
from pathlib import Path

import poil_drake as poil

# Laid over the package's scenario; a file of your own works as well, `LoadScenario(filename=...)`.
TASK = """
directives:
- add_model: {name: table, file: "package://poil_drake/fixtures/table.sdf"}
- add_weld: {parent: world, child: "table::table"}
- add_model: {name: rack, file: "package://poil_drake/fixtures/rack.sdf"}
- add_weld:
    parent: world
    child: rack::stand
    X_PC: {translation: [0.52, 0.27, 0.0], rotation: !Rpy {deg: [0, 0, 15]}}
- add_model: {name: panda, file: "package://poil_drake_panda/panda.urdf"}
- add_weld: {parent: world, child: "panda::panda_link0"}
- add_model:
    name: mug
    file: package://poil_drake/mugs/mug_b/mug_b.sdf
    default_free_body_pose:
      body: {translation: [0.45, -0.15, 0.0], rotation: !Rpy {deg: [0, 0, 60]}}
"""

scenario = poil.LoadScenario(filename=poil.default_scenario_file(), data=TASK)
outputs = poil.OutputPaths.under(Path(sys.argv[1]))
summary = poil.RunSkill(scenario, outputs=outputs, show=False)
print(summary.closing_line())
