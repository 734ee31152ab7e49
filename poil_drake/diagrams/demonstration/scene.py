"""The scene of a simulated demonstration: the scenario's models, without its robot."""

from dataclasses import replace

import numpy as np
from pydrake.geometry import CalcObb, QueryObject
from pydrake.lcm import DrakeLcmParams
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import ApplyLcmBusConfig

from poil_drake.diagrams.demonstration.directives import demonstration_directives
from poil_drake.diagrams.scenario.models import (
    AddModels,
    AddPackages,
    AddScenarioPlant,
    CollisionGeometries,
    ModelGeometry,
    RequireFreeObject,
    RequireModel,
    SetInitialPositions,
)
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import NO_NETWORK, Scenario
from poil_drake.diagrams.station.cameras.cameras import AddCameras, MakeFrame
from poil_drake.diagrams.station.cameras.incremental_renderer import IncrementalRenderer
from poil_drake.diagrams.station.cameras.labels import AssignLabels
from poil_drake.perception.images import CameraModel, MultiViewFrame

_OWN_MUGS = "package://poil_drake/mugs/"
_OWN_MUGS_PART = "handle"


class DemonstrationScene:
    """The scenario's table, fixture and cameras, and the demonstration's object; no robot.

    Nothing is simulated: the caller sets the object's pose and captures images.

    Args:
        scenario: The scenario. Its robot is removed; `demonstration_object` replaces its object.
        cameras: Whether to add the scenario's cameras and their renderer.

    Attributes:
        object_name: Model instance of the object.
        fixture_name: Model instance of the fixture.
        part_link: Link of the object's functional part, or regular expression for its geometries.
        camera_names: Names of the cameras.

    Raises:
        ScenarioError: The directives cannot be processed; a model, part or joint that the
            scenario names does not exist; or a camera cannot be used.
    """

    def __init__(self, scenario: Scenario, *, cameras: bool = True):
        poil = scenario.poil
        builder = DiagramBuilder()
        self._plant, self._scene_graph = AddScenarioPlant(builder, scenario)
        parser = Parser(self._plant)
        AddPackages(parser)
        directives, removed = demonstration_directives(scenario, parser.package_map())
        AddModels(parser, directives)
        for role, name in (("object", poil.object), ("fixture", poil.fixture)):
            RequireModel(self._plant, name, role)
        # The demonstration's object may have other joints.
        SetInitialPositions(self._plant, scenario, without={*removed, poil.object})
        parts = demonstrated_parts(poil)
        self._label_ids = AssignLabels(
            plant=self._plant, scene_graph=self._scene_graph, parts={poil.object: parts}
        )
        self._plant.Finalize()
        RequireFreeObject(self._plant, poil.object)
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
        self.object_name, self.fixture_name = poil.object, poil.fixture
        self.part_link = parts[poil.part]
        self.camera_names = tuple(camera.name for camera in self._cameras)
        self._renderer = IncrementalRenderer(self._diagram, self._scene_graph, self.camera_names)

    def put_object(self, X_WO: np.ndarray) -> None:
        """Sets the object's (4, 4) pose in the world [m]."""
        plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        body = self._first_body(self.object_name)
        self._plant.SetFreeBodyPose(plant_context, body, RigidTransform(X_WO))

    def capture(self, time: float, *, labels: bool) -> MultiViewFrame:
        """Captures images with noise seeded by `time` [s], and with label images if `labels`."""
        self._context.SetTime(time)
        images = self._renderer.capture(self._context)
        if labels:
            ports = [self._diagram.GetOutputPort(f"{n}.label_image") for n in self.camera_names]
            found = [port.Eval(self._context).data[:, :, 0] for port in ports]
            images = tuple(replace(i, label=n) for i, n in zip(images, found, strict=True))
        return MakeFrame(self._cameras, images, self._label_ids)

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

    def model_position(self, model: str) -> np.ndarray:
        """Returns the position of a model's first body in the world [m]."""
        plant_context = self._plant.GetMyContextFromRoot(self._context)
        return self._first_body(model).EvalPoseInWorld(plant_context).translation()

    def distance(self, X_WO: np.ndarray, object_part: str, model: str, part: str) -> float:
        """Puts the object at X_WO; returns the signed distance [m] between the two parts."""
        self.put_object(X_WO)
        query = self._query()
        return min(
            query.ComputeSignedDistancePairClosestPoints(a.id, b.id).distance
            for a in self._collision_geometries(self.object_name, object_part)
            for b in self._collision_geometries(model, part)
        )

    def _query(self) -> QueryObject:
        return self._diagram.GetOutputPort("query_object").Eval(self._context)

    def _first_body(self, model: str) -> RigidBody:
        instance = self._plant.GetModelInstanceByName(model)
        return self._plant.get_body(self._plant.GetBodyIndices(instance)[0])

    def _collision_geometries(self, model: str, part: str) -> list[ModelGeometry]:
        return CollisionGeometries(self._plant, self._scene_graph.model_inspector(), model, part)


def demonstrated_parts(poil: PoilConfig) -> dict[str, str]:
    """Returns part name -> link or expression for geometries, for the demonstration's object.

    The package's mugs have the link "handle". For other objects, `poil.parts` applies.
    """
    if poil.demonstration_object.startswith(_OWN_MUGS):
        return {poil.part: _OWN_MUGS_PART}
    return {poil.part: poil.part, **poil.parts}
