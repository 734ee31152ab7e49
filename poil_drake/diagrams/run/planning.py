"""From a demonstration and a scenario to an execution plan."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.diagrams.loop.scenario_tracker import MakeScenarioTracker
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.planner import PlannerConfig, plan_execution
from poil_drake.perception.detectors.registry import make_detector
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import MultiViewFrame
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.transfer.pipeline import TransferConfig, transfer

Progress = Callable[[str, float], None]


@dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """How a demonstration becomes a plan.

    Attributes:
        scene_fusion: How all that the cameras see becomes obstacle points; coarser than for the
            object, but fine enough to tell contact of the object with the fixture. A few stray
            points do no harm, so none are sought.
        planner: How the grasp and the way to it are chosen.
    """

    scene_fusion: FusionConfig = field(
        default_factory=lambda: FusionConfig(voxel_size=0.004, outlier_neighbours=0)
    )
    planner: PlannerConfig = field(default_factory=PlannerConfig)


def PlanScenario(
    scenario: Scenario,
    demonstration: str | Path,
    *,
    hardware: bool = False,
    output: str | Path | None = None,
    config: PlanningConfig | None = None,
    progress: Progress | None = None,
) -> ExecutionPlan:
    """Transfers a demonstration to the scenario's object and chooses a grasp.

    The scene is looked at once, through the station's cameras, as it stands at the start.

    Args:
        scenario: The station and the task.
        demonstration: A recorded demonstration (MCAP).
        hardware: Whether the station is the real robot, which is looked at and not moved.
        output: Where to save the plan, and beside it an HTML page that shows it; None: nowhere.
        config: All parameters; of table, boxes and field, the scenario's values are taken.
        progress: Told what is being done and which share of it, in [0, 1].

    Raises:
        PoilError: One of its kinds: the demonstration is damaged, a part is not seen, the motion
            cannot be transferred, no grasp is feasible.
    """
    config = config or PlanningConfig()
    poil = scenario.poil
    recorded = load_demonstration(demonstration)
    detector = make_detector(poil.detector)
    tracker = MakeScenarioTracker(poil)
    with MakeStation(
        scenario, hardware=hardware, dry_run=True, ignore_output_delay=True
    ) as station:
        context = station.CreateDefaultContext()
        frame = CaptureFrame(station, context, labels=True)
        q_start = station.ArmPosition(context)
    transfer_config = TransferConfig()
    transferred = transfer(
        recorded,
        frame,
        detector=detector,
        tracker=tracker,
        object_label=poil.object,
        part_label=poil.part,
        demonstration_object_label=poil.demonstration_object_label,
        config=replace(transfer_config, num_points=poil.num_points),
        progress=progress,
    )
    model = PandaModel(X_WB=station.robot_base_pose().GetAsMatrix4())
    result = plan_execution(
        transferred.matchings,
        object_label=poil.object,
        part_label=poil.part,
        object_cloud=transferred.object_cloud,
        part_points=transferred.part_cloud.points,
        scene_points=_everything(frame, config.scene_fusion),
        q_start=q_start,
        model=model,
        config=_with_the_scenarios_values(config.planner, poil),
        seed=scenario.random_seed,
        metadata={
            "poil_drake": version("poil-drake"),
            "drake": version("drake"),
            "demonstration": Path(demonstration).name,
        },
        progress=progress,
    )
    if output is not None:
        from poil_drake.grasping.plan_page import write_plan_page

        result.plan.save(output)
        write_plan_page(Path(output).with_suffix(".html"), result, X_WB=model.X_WB)
    return result.plan


def _with_the_scenarios_values(config: PlannerConfig, poil: PoilConfig) -> PlannerConfig:
    """Returns the planner's parameters with the scene's table and boxes, and the field."""
    path = replace(
        config.path,
        field=BcsdmConfig(eta=poil.eta),
        max_angular_speed=poil.max_angular_speed,
        max_linear_speed=poil.max_linear_speed,
    )
    collision = replace(config.feasibility.collision, ground_height=poil.table_height)
    feasibility = replace(config.feasibility, collision=collision, posture=poil.safety.posture)
    return replace(config, path=path, feasibility=feasibility)


def _everything(frame: MultiViewFrame, fusion: FusionConfig) -> np.ndarray:
    masks = tuple(np.ones(image.depth.shape, dtype=bool) for image in frame.images)
    return fuse_views(frame, masks, fusion).points
