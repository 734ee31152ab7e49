"""Contact properties of geometries whose model files state none."""

import math

from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddCompliantHydroelasticPropertiesForHalfSpace,
    AddRigidHydroelasticProperties,
    Capsule,
    Cylinder,
    DefaultProximityProperties,
    Ellipsoid,
    HalfSpace,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.drake_errors import DrakeErrorsExplained
from poil_drake.diagrams.scenario.scenario import Scenario

_SEGMENTS = 16
"""Straight edges around a round shape. Its facets are 2 % of the radius off: 0.5 mm at the thickest
cylinder that fits the hand, 0.1 mm at a handle. The computing time grows with their number."""

_MODULUS = 1e7  # [Pa] Drake's default.
_SLAB_THICKNESS = 0.05  # [m] of half-spaces, which are the planes of MJCF files: a table top's.
_GROUP = "hydroelastic"


def ApplySceneGraphConfig(
    plant: MultibodyPlant, scene_graph: SceneGraph, scenario: Scenario
) -> None:
    """Applies `scene_graph_config` to the geometries that state no contact properties.

    With the compliance type "undefined", which is the default, geometries that can move become
    rigid and those that are fixed to the world become compliant. The compliant finger pads then
    hold every object by a surface of contact instead of single points, and objects stand still on
    every table. Spheres, which touch at one point anyway, keep point contact. Other round shapes
    without a resolution get one that suits their radius.

    Args:
        plant: The finalized plant.
        scene_graph: The plant's scene graph.
        scenario: The scenario.

    Raises:
        ScenarioError: Drake rejects `scene_graph_config`.
    """
    with DrakeErrorsExplained(
        "scene_graph_config cannot be used",
        remedy="Use values that the documentation of Drake's DefaultProximityProperties allows; "
        "compliance_type is undefined, rigid or compliant.",
    ):
        scene_graph.set_config(scenario.scene_graph_config)
    if scenario.plant_config.contact_model == "point":
        return
    defaults = scenario.scene_graph_config.default_proximity_properties
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
        properties = _completed(
            inspector.GetProximityProperties(geometry),
            inspector.GetShape(geometry),
            defaults,
            is_fixed=plant.IsAnchored(body),
        )
        scene_graph.AssignRole(source, geometry, properties, RoleAssign.kReplace)


def _completed(
    given: ProximityProperties,
    shape: Shape,
    defaults: DefaultProximityProperties,
    *,
    is_fixed: bool,
) -> ProximityProperties:
    """Returns a copy of a geometry's properties with the hydroelastic ones that it lacks."""
    completed = ProximityProperties(given)
    resolution = given.GetPropertyOrDefault(
        _GROUP, "resolution_hint", defaults.resolution_hint or _resolution(shape)
    )
    modulus = given.GetPropertyOrDefault(
        _GROUP, "hydroelastic_modulus", defaults.hydroelastic_modulus or _MODULUS
    )
    stated = given.HasProperty(_GROUP, "compliance_type")
    if stated or defaults.compliance_type != "undefined" or isinstance(shape, Sphere):
        completed.UpdateProperty(_GROUP, "resolution_hint", resolution)
        return completed
    for name in ("resolution_hint", "hydroelastic_modulus"):
        completed.RemoveProperty(_GROUP, name)  # Drake's functions add it again.
    if not is_fixed:
        AddRigidHydroelasticProperties(resolution, completed)
    elif isinstance(shape, HalfSpace):
        thickness = defaults.slab_thickness or _SLAB_THICKNESS
        AddCompliantHydroelasticPropertiesForHalfSpace(thickness, modulus, completed)
    else:
        AddCompliantHydroelasticProperties(resolution, modulus, completed)
    return completed


def _resolution(shape: Shape) -> float:
    """Returns the length of a round shape's edges [m]; Drake ignores it for other shapes."""
    if isinstance(shape, Ellipsoid):
        radius = max(shape.a(), shape.b(), shape.c())
    elif isinstance(shape, Sphere | Cylinder | Capsule):
        radius = shape.radius()
    else:
        radius = 1.0
    return 2.0 * math.pi * radius / _SEGMENTS
