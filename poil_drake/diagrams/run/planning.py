"""Makes an execution plan from a demonstration and a scenario."""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.run.detection import DetectParts
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import (
    CaptureFrame,
    MakeStation,
    RequireFreeStart,
    WithoutRobot,
)
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.grasp_motions import WorkspaceCheck
from poil_drake.grasping.planner import PlannerConfig, plan_execution
from poil_drake.perception.detectors.registry import LABEL_IMAGE, require_detector
from poil_drake.perception.fusion import fuse_views
from poil_drake.perception.plausibility import check_plausible
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.worker_executor import WorkerExecutor
from poil_drake.transfer.pipeline import TransferConfig, transfer
from poil_drake.transfer.progress import Progress


def PlanScenario(
    scenario: Scenario,
    demonstration: str | Path,
    *,
    hardware: bool = False,
    output: str | Path | None = None,
    progress: Progress | None = None,
) -> ExecutionPlan:
    """Transfers a demonstration to the scenario's object, chooses a grasp, and returns the plan.

    The station's cameras capture the scene once, in its initial state.

    Args:
        scenario: The station and the task.
        demonstration: A recorded demonstration (MCAP).
        hardware: Whether the station is the real robot. It does not move during planning.
        output: File for the plan. An HTML page that shows the plan is written beside it. None
            writes neither file.
        progress: Called with the name of each step and its completed fraction, in [0, 1].

    Raises:
        PoilError: if the demonstration is damaged, a part is not detected, the motion cannot be
            transferred, or no grasp is feasible.
    """
    poil = scenario.poil
    recorded = load_demonstration(demonstration)
    recorded.check_plausible(table_height=poil.table_height)
    require_detector(poil.detector, poil.detector_config)
    tracker = MakeScenarioTracker(poil)
    with WorkerExecutor("poil_drake.grasping.planner", "torch") as worker:
        with MakeStation(
            scenario, hardware=hardware, dry_run=True, ignore_output_delay=True
        ) as station:
            RequireFreeStart(station)
            context = station.CreateDefaultContext()
            frame = CaptureFrame(station, context, labels=poil.detector == LABEL_IMAGE)
            seen = WithoutRobot(station, context, frame)
            q_start = station.ArmPosition(context)
        model = PandaModel(X_WB=station.robot_base_pose().GetAsMatrix4())
        planner = _planner_config(poil)
        # Refuses an arm outside its box before the transfer, which takes long.
        WorkspaceCheck(model=model, q_start=q_start, feasibility=planner.feasibility)
        check_plausible(frame, table_height=poil.table_height)
        everything = tuple(np.ones(image.depth.shape, dtype=bool) for image in frame.images)
        scene = worker.submit(fuse_views, frame, everything, poil.fusion.coarser())
        found = DetectParts(poil, recorded, seen, tracker=tracker, progress=progress)
        transferred = transfer(
            recorded,
            frame,
            source_masks=found.source,
            target_masks=found.target,
            tracker=tracker,
            tracks=found.tracks,
            config=TransferConfig(num_points=poil.num_points, fusion=poil.fusion),
            executor=worker,
            progress=progress,
        )
        scene_points = scene.result().points
        result = plan_execution(
            transferred.matchings,
            object_label=poil.object,
            part_label=poil.part,
            object_cloud=transferred.object_cloud,
            part_points=transferred.part_cloud.points,
            scene_points=scene_points,
            q_start=q_start,
            model=model,
            config=planner,
            seed=scenario.random_seed,
            metadata={
                "poil_drake": version("poil-drake"),
                "drake": version("drake"),
                "demonstration": Path(demonstration).name,
            },
            executor=worker,
            progress=progress,
        )
    if output is not None:
        from poil_drake.grasping.plan_page import write_plan_page

        result.plan.save(output)
        write_plan_page(Path(output).with_suffix(".html"), result, X_WB=model.X_WB)
    return result.plan


def _planner_config(poil: PoilConfig) -> PlannerConfig:
    """Returns the planner's configuration with the scenario's settings."""
    config = PlannerConfig(sampling=poil.grasp)
    path = replace(
        config.path,
        field=BcsdmConfig(eta=poil.eta),
        max_angular_speed=poil.max_angular_speed,
        max_linear_speed=poil.max_linear_speed,
    )
    collision = replace(poil.clearance, ground_height=poil.table_height)
    feasibility = replace(config.feasibility, collision=collision, posture=poil.safety.posture)
    return replace(config, path=path, feasibility=feasibility)
