"""The scene of a simulated demonstration: the scenario's models, without its robot."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydrake.geometry import CalcObb, QueryObject, Role, SceneGraph
from pydrake.lcm import DrakeLcmParams
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import AddModel, ModelDirective, Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import ApplyLcmBusConfig

from poil_drake.diagrams.demonstration.directives import (
    demonstrated_parts,
    demonstration_directives,
    is_held_by_larger_model,
)
from poil_drake.diagrams.scenario.concave_meshes import ReplaceConcaveMeshes
from poil_drake.diagrams.scenario.meshes import MakeMeshesDrawable, RequireMetres
from poil_drake.diagrams.scenario.model_checks import CheckModels
from poil_drake.diagrams.scenario.model_parts import (
    BaseBody,
    CollisionGeometries,
    GeometryChoices,
    ModelBodies,
    ModelGeometry,
    RequireFreeObject,
    RequireModels,
)
from poil_drake.diagrams.scenario.models import (
    AddModels,
    AddPackages,
    AddScenarioPlant,
    FinishModels,
    FlatDirectives,
    SetInitialPositions,
)
from poil_drake.diagrams.scenario.penetrations import Penetration, Penetrations
from poil_drake.diagrams.scenario.scenario import NO_NETWORK, Scenario
from poil_drake.diagrams.station.cameras.cameras import AddCameras
from poil_drake.diagrams.station.cameras.incremental_renderer import IncrementalRenderer
from poil_drake.diagrams.station.cameras.labels import AssignLabels
from poil_drake.perception.images import CameraModel, MultiViewFrame, by_name
from poil_drake.robots.panda import BASE_LINK

_STAND_IN = "demonstrated_object"

_FAR_BELOW = 1e5  # [m]; distances from so far below are heights


class DemonstrationScene:
    """The scenario's table, fixture and cameras, and the demonstration's object; no robot.

    Nothing is simulated: the caller sets the object's pose and captures images.

    Args:
        scenario: The scenario. Its robot is removed; `demonstration_object` replaces its object.
        cameras: Whether to add the scenario's cameras and their renderer.

    Attributes:
        object_name: Model of the object.
        fixture_name: Model of the fixture.
        part_link: Link of the object's functional part, or regular expression for its geometries.
        camera_names: Names of the cameras.
        table_height: Height of the plane on which objects stand [m, world].
        object_position: (3,) where the scenario's own object starts [m, world].
        robot_position: (3,) the position of the robot's base [m, world].

    Raises:
        ScenarioError: The directives cannot be processed; a model, part or joint that the
            scenario names does not exist; or a camera cannot be used.
    """

    def __init__(self, scenario: Scenario, *, cameras: bool = True):
        poil = scenario.poil
        builder = DiagramBuilder()
        self._plant, self._scene_graph = AddScenarioPlant(builder, scenario)
        parser = Parser(self._plant)
        AddPackages(parser, scenario)
        directives, removed = demonstration_directives(scenario, parser.package_map())
        AddModels(parser, directives)
        RequireModels(self._plant, {"object": poil.object, "fixture": poil.fixture})
        self.object_name, self.fixture_name = poil.object, poil.fixture
        if is_held_by_larger_model(directives, poil):
            self.object_name = _STAND_IN
            _remove_geometry(self._plant, self._scene_graph, ModelBodies(self._plant, poil.object))
            stand_in = AddModel(name=_STAND_IN, file=poil.demonstration_object)
            AddModels(parser, [ModelDirective(add_model=stand_in)])
        RequireMetres(self._scene_graph)
        ReplaceConcaveMeshes(self._plant, self._scene_graph, poil)
        # The demonstration's object may have other joints.
        SetInitialPositions(self._plant, scenario, without={*removed, poil.object})
        parts = demonstrated_parts(poil)
        label_ids = AssignLabels(
            plant=self._plant,
            scene_graph=self._scene_graph,
            parts={self.object_name: parts, poil.fixture: {}},
        )
        MakeMeshesDrawable(self._plant, self._scene_graph)
        self._label_ids = {
            "/".join([poil.object, *name.split("/")[1:]])
            if name.split("/")[0] == self.object_name
            else name: ids
            for name, ids in label_ids.items()
        }
        FinishModels(self._plant, directives)
        CheckModels(self._plant, self._scene_graph.model_inspector(), self.object_name)
        self._cameras: tuple[CameraModel, ...] = ()
        if cameras:
            # The cameras' configuration names buses, but a recording is not published.
            silent = {name: DrakeLcmParams(lcm_url=NO_NETWORK) for name in scenario.lcm_buses}
            self._cameras = AddCameras(
                builder=builder,
                plant=self._plant,
                scenario=scenario,
                lcm_buses=ApplyLcmBusConfig(silent, builder),
            )
        builder.ExportOutput(self._scene_graph.get_query_output_port(), "query_object")
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        part = parts[poil.part]
        self.part_link = part if isinstance(part, str) else poil.part
        self.table_height = poil.table_height
        self.object_position, self.robot_position = _positions_in_run(scenario)
        self.camera_names = tuple(camera.name for camera in self._cameras)
        self._renderer = IncrementalRenderer(self._diagram, self._scene_graph, self.camera_names)

    def put_object(self, X_WO: np.ndarray) -> None:
        """Sets the object's (4, 4) pose in the world [m]."""
        plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        body = BaseBody(self._plant, self.object_name)
        self._plant.SetFreeBodyPose(plant_context, body, RigidTransform(X_WO))

    def capture(self, time: float, *, labels: bool) -> MultiViewFrame:
        """Captures images with noise seeded by `time` [s], and with label images if `labels`."""
        self._context.SetTime(time)
        images = by_name(self.camera_names, self._renderer.capture(self._context))
        if labels:
            ports = [self._diagram.GetOutputPort(f"{n}.label_image") for n in self.camera_names]
            found = [port.Eval(self._context).data[:, :, 0] for port in ports]
            images = tuple(replace(i, label=n) for i, n in zip(images, found, strict=True))
        label_ids = self._label_ids if labels else {}
        return MultiViewFrame(cameras=self._cameras, images=images, label_ids=label_ids)

    def boxes(self, model: str, part: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """Returns an oriented bounding box for each collision geometry of a part.

        Args:
            model: The model instance.
            part: A link, or a regular expression for names of the model's geometries.

        Returns:
            The (4, 4) pose of each box's centre in the world [m] and its (3,) half sizes [m];
            empty if the model has no such part.
        """
        found = []
        for geometry_id, *_ in self._collision_geometries(model, part):
            box = CalcObb(self._scene_graph.model_inspector().GetShape(geometry_id))
            if box is not None:
                X_WG = self._query().GetPoseInWorld(geometry_id)
                found.append(((X_WG @ box.pose()).GetAsMatrix4(), box.half_width()))
        return found

    def collision_choices(self, model: str) -> str:
        """Returns which parts of a model collide, for error messages."""
        return GeometryChoices(self._collision_geometries(model, ".*"))

    def model_position(self, model: str) -> np.ndarray:
        """Returns the position of a model's base body in the world [m]."""
        plant_context = self._plant.GetMyContextFromRoot(self._context)
        return BaseBody(self._plant, model).EvalPoseInWorld(plant_context).translation()

    def distance(self, X_WO: np.ndarray, object_part: str, model: str, part: str) -> float:
        """Puts the object at X_WO; returns the signed distance [m] between the two parts."""
        self.put_object(X_WO)
        query = self._query()
        return min(
            query.ComputeSignedDistancePairClosestPoints(a.id, b.id).distance
            for a in self._collision_geometries(self.object_name, object_part)
            for b in self._collision_geometries(model, part)
        )

    @property
    def has_collision_geometry(self) -> bool:
        """Whether the object has collision geometries."""
        return bool(self._collision_geometries(self.object_name, ".*"))

    def lowest_point(self, X_WO: np.ndarray) -> float:
        """Puts the object at X_WO; returns the height of its lowest point [m, world].

        An object without collision geometries counts as a point at its frame's origin.
        """
        self.put_object(X_WO)
        own = {g.id for g in self._collision_geometries(self.object_name, ".*")}
        below = X_WO[:3, 3] - [0.0, 0.0, _FAR_BELOW]
        near = self._query().ComputeSignedDistanceToPoint(below)
        heights = [below[2] + found.distance for found in near if found.id_G in own]
        return min(heights, default=float(X_WO[2, 3]))

    def penetrations(self, X_WO: np.ndarray) -> list[Penetration]:
        """Puts the object at X_WO; returns what it is inside."""
        self.put_object(X_WO)
        name, fixture = self.object_name, self.fixture_name
        return Penetrations(self._plant, self._query(), name, fixture=fixture)

    def _query(self) -> QueryObject:
        return self._diagram.GetOutputPort("query_object").Eval(self._context)

    def _collision_geometries(self, model: str, part: str) -> list[ModelGeometry]:
        return CollisionGeometries(self._plant, self._scene_graph.model_inspector(), model, part)


def _positions_in_run(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Returns the positions (3,) of the scenario's own object and of its robot's base [m, world].

    The origin stands for a robot that the scenario lacks.
    """
    poil, plant = scenario.poil, MultibodyPlant(time_step=0.0)
    parser = Parser(plant)
    AddPackages(parser, scenario)
    directives = FlatDirectives(scenario.directives, parser.package_map())
    AddModels(parser, directives)
    FinishModels(plant, directives)
    RequireModels(plant, {"object": poil.object})
    RequireFreeObject(plant, poil.object)
    bodies = [BaseBody(plant, poil.object)]
    if plant.HasModelInstanceNamed(poil.robot):
        robot = plant.GetModelInstanceByName(poil.robot)
        bodies.append(plant.GetBodyByName(BASE_LINK, robot))
    context = plant.CreateDefaultContext()
    positions = [body.EvalPoseInWorld(context).translation() for body in bodies]
    return positions[0], positions[1] if len(positions) > 1 else np.zeros(3)


def _remove_geometry(
    plant: MultibodyPlant, scene_graph: SceneGraph, bodies: Sequence[BodyIndex]
) -> None:
    inspector = scene_graph.model_inspector()
    for body in bodies:
        for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body)):
            for role in (Role.kProximity, Role.kPerception, Role.kIllustration):
                scene_graph.RemoveRole(plant.get_source_id(), geometry, role)
