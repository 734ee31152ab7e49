"""Your own station: an obstacle beside the rack, and a list of the bodies that touch something.

Needs a plan from `poil transfer`: python examples/own_station.py out/plan.npz
"""

import sys

from pydrake.multibody.parsing import Parser
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

import poil_drake as poil

BOX = """
<sdf version="1.9">
  <model name="box">
    <static>true</static>
    <pose>0.75 -0.3 0.1 0 0 0.5</pose>
    <link name="box">
      <visual name="box"><geometry><box><size>0.1 0.1 0.2</size></box></geometry></visual>
      <collision name="box"><geometry><box><size>0.1 0.1 0.2</size></box></geometry></collision>
    </link>
  </model>
</sdf>
"""


def add_box(parser: Parser) -> None:
    """Adds a box that no directive names."""
    parser.AddModelsFromString(BOX, "sdf")


def touched(station: poil.Station, context: Context) -> set[str]:
    """Returns the names of the bodies that touch another body."""
    plant, inspector = station.plant(), station.scene_graph().model_inspector()
    results = plant.get_contact_results_output_port().Eval(plant.GetMyContextFromRoot(context))
    points = [results.point_pair_contact_info(i) for i in range(results.num_point_pair_contacts())]
    indices = {index for pair in points for index in (pair.bodyA_index(), pair.bodyB_index())}
    for i in range(results.num_hydroelastic_contacts()):
        surface = results.hydroelastic_contact_info(i).contact_surface()
        frames = [inspector.GetFrameId(geometry) for geometry in (surface.id_M(), surface.id_N())]
        indices |= {plant.GetBodyFromFrameId(frame).index() for frame in frames}
    return {plant.get_body(index).scoped_name().get_full() for index in indices}


plan = poil.ExecutionPlan.load(sys.argv[1])
# The ground truth in place of a tracker: no cameras are needed.
scenario = poil.LoadScenario(
    filename=poil.default_scenario_file(), data="{poil: {tracker: ground_truth}}"
)
station = poil.MakeStation(scenario, cameras=False, parser_prefinalize_callback=add_box)
with poil.MakeClosedLoop(scenario, plan, station=station) as loop:
    simulator = Simulator(loop.diagram)
    seen: set[str] = set()

    def watch(root: Context) -> EventStatus:
        """Adds the bodies that are in contact to `seen`. Drake calls this after each step."""
        seen.update(touched(station, root))
        return EventStatus.DidNothing()

    simulator.set_monitor(watch)
    simulator.AdvanceTo(float(sys.argv[2]) if len(sys.argv) > 2 else 16.0)
print("touched something:", ", ".join(sorted(seen)))
