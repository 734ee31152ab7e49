"""Sequences of images with known truth, rendered by the simulator."""

from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import AddModel, ModelDirective
from pydrake.systems.framework import Context

from poil_drake.benchmarks.tracking.carried_motion import (
    CarriedMotion,
    hanging_motion,
    still_motion,
    with_slip,
)
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.randomization import ObjectDirective
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.incremental_renderer import IncrementalRenderer
from poil_drake.diagrams.station.station import MakeStation, SimulatedStation
from poil_drake.errors import DetectionError, InvalidValueError
from poil_drake.geometry.point_cloud import farthest_point_sampling
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.fusion import fuse_views
from poil_drake.perception.images import MultiViewFrame, by_name
from poil_drake.robots.panda import ARM_JOINTS, FINGER_JOINTS
from poil_drake.robots.panda_kinematics import PandaModel

HANG, SLIP, STILL = "hang", "slip", "still"
"""The kinds of sequences."""

_STILL_TIME = 5.0  # [s]
_FEWEST_POINTS = 30  # of the part, in voxels of 2 mm
_OTHER_SEEDS = 1000  # between the seeds that are tried for one sequence

_CLUTTER = (("book", 0.17, 0.10), ("cube", 0.02, -0.14), ("cube", -0.13, -0.05))
"""Other objects on the table: model, and x and y from the object [m]."""


@dataclass(frozen=True, eq=False)
class TrackingSequence:
    """A stream of frames and its truth.

    Attributes:
        frames: T frames with label images and with the cameras' usual noise.
        motion: The motion of arm and object at the frames' times.
        masks: Object and part in the first frame.
        poil: The scenario's settings.
    """

    frames: tuple[MultiViewFrame, ...]
    motion: CarriedMotion
    masks: PartMasks
    poil: PoilConfig

    def query_points(self, first: MultiViewFrame) -> np.ndarray:
        """Returns points (N, 3) of the part as the first frame, with its faults, shows them.

        Raises:
            DetectionError: if the part is hardly seen.
        """
        cloud = fuse_views(first, self.masks.part_masks, self.poil.fusion).points
        if len(cloud) < _FEWEST_POINTS:
            raise DetectionError("The part is hardly seen.", remedy="Use another seed.")
        return cloud[farthest_point_sampling(cloud, self.poil.num_points)]

    def moved(self, points: np.ndarray, index: int) -> np.ndarray:
        """Returns where points (N, 3) on the object in the first frame are in a later one."""
        X_WO = self.motion.object_poses
        return transform_points(X_WO[index] @ inverse(X_WO[0]), points)


def slip_time(motion: CarriedMotion) -> float:
    """Returns when faults begin and the object slips: a third into the transport [s]."""
    start, end = motion.carried
    return start + (end - start) / 3.0


def MakeSequence(
    kind: str, seed: int, *, max_frames: int | None = None, data: str | None = None
) -> TrackingSequence:
    """Renders a sequence with a random mug at a random pose.

    Where no grasp reaches the motion, or no camera shows enough of the handle, the next of a series
    of seeds is tried.

    Args:
        kind: HANG, SLIP or STILL.
        seed: Seed of the mug, its pose, the slip and the noise.
        max_frames: Frames to render, evenly spaced in the motion; None for all.
        data: YAML merged over the package's scenario.
    """
    for attempt in count(seed, _OTHER_SEEDS):
        scenario = _with_clutter(ChooseScenario(seed=attempt, data=data))
        try:
            return _render(scenario, kind, attempt, max_frames)
        except (InvalidValueError, DetectionError):
            continue
    raise AssertionError


def _with_clutter(scenario: Scenario) -> Scenario:
    """Returns the scenario with other objects on its table."""
    mug = ObjectDirective(list(scenario.directives), scenario.poil.object)
    (pose,) = mug.default_free_body_pose.values()
    extra = []
    for number, (name, x, y) in enumerate(_CLUTTER):
        model = AddModel(name=f"other_{number}", file=f"package://poil_drake/objects/{name}.sdf")
        at = np.add(pose.translation, [x, y, 0.03])
        model.default_free_body_pose = {"body": Transform(RigidTransform(at))}
        extra.append(ModelDirective(add_model=model))
    return replace(scenario, directives=[*scenario.directives, *extra])


def _render(scenario: Scenario, kind: str, seed: int, max_frames: int | None) -> TrackingSequence:
    station = MakeStation(scenario, ignore_output_delay=True)
    assert isinstance(station, SimulatedStation)
    context = station.CreateDefaultContext()
    home = station.ArmPosition(context)
    model = PandaModel(X_WB=station.robot_base_pose().GetAsMatrix4())
    plant_context = station.GetSubsystemContext(station.plant(), context)
    X_WO = station.object_body().EvalPoseInWorld(plant_context).GetAsMatrix4()
    where = {"X_WO": X_WO, "model": model, "home": home}
    motion = still_motion(scenario, **where, duration=_STILL_TIME)
    renderer = IncrementalRenderer(station, station.scene_graph(), station.camera_names)
    first = _capture(station, context, renderer, motion, 0)
    found = LabelImageDetector().detect(
        first, object_label=scenario.poil.object, part_label=scenario.poil.part
    )
    # Fails for a mug whose handle is turned away.
    TrackingSequence((first,), motion, found, scenario.poil).query_points(first)
    if kind != STILL:
        motion = hanging_motion(scenario, **where)
    if kind == SLIP:
        motion = with_slip(motion, slip_time(motion), np.random.default_rng(seed))
    total = len(motion.times)
    kept = np.unique(np.linspace(0, total - 1, min(total, max_frames or total)).astype(int))
    motion = _selected(motion, kept)
    rest = (_capture(station, context, renderer, motion, k) for k in range(1, len(kept)))
    return TrackingSequence((first, *rest), motion, found, scenario.poil)


def _selected(motion: CarriedMotion, kept: np.ndarray) -> CarriedMotion:
    """Returns the motion at some of its times."""
    return CarriedMotion(
        times=motion.times[kept],
        postures=motion.postures[kept],
        widths=motion.widths[kept],
        hand_poses=motion.hand_poses[kept],
        object_poses=motion.object_poses[kept],
        held=motion.held[kept],
        priors=motion.priors[kept],
        carried=motion.carried,
    )


def _capture(
    station: SimulatedStation,
    context: Context,
    renderer: IncrementalRenderer,
    motion: CarriedMotion,
    index: int,
) -> MultiViewFrame:
    """Puts arm, hand and object where the motion has them, and captures a labelled frame."""
    plant = station.plant()
    plant_context = station.GetMutableSubsystemContext(plant, context)
    for joint, angle in zip(ARM_JOINTS, motion.postures[index], strict=True):
        plant.GetJointByName(joint).set_angle(plant_context, angle)
    for joint in FINGER_JOINTS:
        plant.GetJointByName(joint).set_translation(plant_context, motion.widths[index] / 2)
    X_WO = RigidTransform(motion.object_poses[index])
    plant.SetFreeBodyPose(plant_context, station.object_body(), X_WO)
    time = float(motion.times[index])
    context.SetTime(time)
    images = by_name(station.camera_names, renderer.capture(context))
    labels = [station.GetOutputPort(f"{n}.label_image").Eval(context) for n in station.camera_names]
    labelled = [
        replace(i, label=n.data[:, :, 0].copy()) for i, n in zip(images, labels, strict=True)
    ]
    return MultiViewFrame(station.camera_models, tuple(labelled), station.label_ids)
