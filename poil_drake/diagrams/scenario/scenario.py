"""The schema of a scenario: one YAML document that describes a station and a task."""

import ipaddress
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from urllib.parse import urlsplit

import numpy as np
from pydrake.geometry import DefaultProximityProperties, SceneGraphConfig
from pydrake.lcm import DrakeLcmParams
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import GetIntegrationSchemes, SimulatorConfig
from pydrake.systems.sensors import CameraConfig
from pydrake.visualization import VisualizationConfig

from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.value_ranges import require_not_negative, require_positive
from poil_drake.errors import ScenarioError
from poil_drake.robots.posture_guard import PostureGuardConfig
from poil_drake.systems.panda.velocity_driver import PandaDriver

GROUND_TRUTH = "ground_truth"
"""The name of the baseline tracker, which uses the simulator's true poses instead of images."""

NO_NETWORK = "memq://null"
"""The address of an LCM network that carries nothing."""

_FINEST_RESOLUTION = 0.001  # [m] The link of an arm then has about 10,000 triangles.

_ROUNDING = 1e-9  # Relative rounding error of decimal numbers.


@dataclass(frozen=True, kw_only=True)
class ScenarioSource:
    """Where a scenario was read from.

    Attributes:
        name: The scenario's name in the file; empty without a file.
        file: The file's path; empty without a file.
    """

    name: str = ""
    file: str = ""


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A station and its task. The keys are those of Drake's hardware_sim, and `poil`.

    Attributes:
        random_seed: Seed of all noise.
        simulation_duration: Longest duration of a run [s].
        simulator_config: Drake's simulator settings. `target_realtime_rate` slows a run down to
            that rate; the option --realtime-rate overrides it. `start_time` must be 0. All systems
            are discrete, so `integration_scheme`, `max_step_size`, `accuracy` and
            `use_error_control` have no effect.
        plant_config: Drake's plant settings, but `poil.rates.plant` replaces `time_step`.
        scene_graph_config: Drake's contact properties of geometries whose models state none. With
            the `compliance_type` undefined, those that can move become rigid and those fixed to the
            world compliant, which suits the compliant finger pads; `rigid` or `compliant` applies
            to both, as in Drake. Without a `resolution_hint`, round shapes get 16 edges around.
            `plant_config.contact_model: point` turns this off.
        directives: The models: files, welds, default poses. A file is `package://...`,
            `file://...`, or a path relative to the scenario file.
        lcm_buses: Name -> LCM network. The default network sends nothing.
        model_drivers: Model instance -> driver, which sets how the model follows commands.
        cameras: Name -> camera. `rgb`, `depth`, `label` and `fps` only choose the images published
            on the camera's LCM bus; the station's ports give all images at any time. With an
            `output_delay` [s], which must be the same for all cameras, images are captured at the
            tracker's rate and reach the ports after the delay. A second process renders them
            during the simulation. Delayed images are not published.
        visualization: What Meshcat shows, and how often.
        initial_position: Model instance -> joint -> position [rad or m].
        poil: The task and POIL's settings.
        source: Where the scenario was read from; not a key of the file.
    """

    random_seed: int = 0
    simulation_duration: float = math.inf
    simulator_config: SimulatorConfig = field(
        default_factory=lambda: SimulatorConfig(
            max_step_size=0.01, use_error_control=False, accuracy=1e-2
        )
    )
    # "sap" softens the contact of the light fingers so much that a held mug tilts.
    plant_config: MultibodyPlantConfig = field(
        default_factory=lambda: MultibodyPlantConfig(
            contact_model="hydroelastic_with_fallback", discrete_contact_approximation="lagged"
        )
    )
    scene_graph_config: SceneGraphConfig = field(
        default_factory=lambda: SceneGraphConfig(
            default_proximity_properties=DefaultProximityProperties(resolution_hint=None)
        )
    )
    directives: list[ModelDirective] = field(default_factory=list)
    lcm_buses: Mapping[str, DrakeLcmParams] = field(
        default_factory=lambda: {"default": DrakeLcmParams(lcm_url=NO_NETWORK)}
    )
    model_drivers: Mapping[str, PandaDriver] = field(default_factory=dict)
    cameras: Mapping[str, CameraConfig] = field(default_factory=dict)
    visualization: VisualizationConfig = field(
        default_factory=lambda: VisualizationConfig(
            publish_period=1 / 32,
            publish_contacts=False,
            publish_inertia=False,
            enable_meshcat_creation=False,
        )
    )
    initial_position: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    poil: PoilConfig = field(default_factory=PoilConfig)
    source: ScenarioSource = field(default_factory=ScenarioSource, metadata={"yaml": False})

    def __post_init__(self) -> None:
        require_not_negative("random_seed", self.random_seed)
        if self.simulation_duration != math.inf:
            require_positive("simulation_duration", self.simulation_duration)
        require_positive("visualization.publish_period", self.visualization.publish_period)
        _check_resolution(self.scene_graph_config)
        _check_directives(self.directives)
        _check_simulator(self.simulator_config)
        _check_time_step(self.plant_config, self.poil)
        _check_buses(self)
        _check_delays(self)
        _check_safety(self.poil)

    @property
    def robot_driver(self) -> PandaDriver:
        """How the robot follows commands: its entry in `model_drivers`, or the default."""
        return self.model_drivers.get(self.poil.robot, PandaDriver())


def _check_resolution(config: SceneGraphConfig) -> None:
    """Checks that meshes of round shapes do not become so fine that they fill the memory."""
    resolution = config.default_proximity_properties.resolution_hint
    if resolution is not None and not resolution >= _FINEST_RESOLUTION:
        raise ScenarioError(
            "scene_graph_config.default_proximity_properties.resolution_hint is "
            f"{resolution} m, which is out of range.",
            remedy=f"It must be at least {_FINEST_RESOLUTION} m; null suits each shape's radius.",
        )


def _check_directives(directives: Sequence[ModelDirective]) -> None:
    """Checks that each directive has one key, and no empty name, file, parent or child."""
    for index, directive in enumerate(directives):
        path = f"directives[{index}]"
        fields = {f.name: getattr(directive, f.name) for f in directive.__fields__}
        given = [name for name, value in fields.items() if value is not None]
        if len(given) != 1:
            raise ScenarioError(
                f"'{path}' holds {' and '.join(given) or 'nothing'} instead of one directive.",
                remedy=f"Begin each directive with its own dash and one of: {', '.join(fields)}.",
            )
        for key in ("name", "file", "parent", "child"):
            if getattr(fields[given[0]], key, None) == "":
                raise ScenarioError(
                    f"'{path}.{given[0]}' has no '{key}'.", remedy=f"Add the key '{key}'."
                )


def _check_simulator(config: SimulatorConfig) -> None:
    """Checks settings that Drake checks only when the simulation starts, or not at all."""
    path = "simulator_config"
    require_positive(f"{path}.max_step_size", config.max_step_size)
    require_positive(f"{path}.accuracy", config.accuracy)
    require_not_negative(f"{path}.target_realtime_rate", config.target_realtime_rate)
    # "cenic" integrates the plant as a continuous system, but ours is discrete.
    schemes = [scheme for scheme in GetIntegrationSchemes() if scheme != "cenic"]
    if config.integration_scheme not in schemes:
        raise ScenarioError(
            f"{path}.integration_scheme '{config.integration_scheme}' is not supported.",
            remedy=f"Choose one of: {', '.join(schemes)}.",
        )
    if config.start_time != 0.0:
        raise ScenarioError(
            f"{path}.start_time is {config.start_time} s, but every run starts at 0 s.",
            remedy="Remove simulator_config.start_time.",
        )


def _check_time_step(config: MultibodyPlantConfig, poil: PoilConfig) -> None:
    """Checks that `plant_config.time_step` does not contradict `poil.rates.plant`."""
    # An omitted key has Drake's default.
    if config.time_step not in (poil.rates.plant, MultibodyPlantConfig().time_step):
        raise ScenarioError(
            f"plant_config.time_step is {config.time_step} s, but poil.rates.plant is "
            f"{poil.rates.plant} s.",
            remedy="Remove plant_config.time_step; only poil.rates.plant is used.",
        )


def _check_safety(poil: PoilConfig) -> None:
    """Checks that the supervisor's limits agree with the other keys of `poil`."""
    height = poil.safety.posture.table_height
    if height not in (poil.table_height, PostureGuardConfig().table_height):
        raise ScenarioError(
            f"poil.safety.posture.table_height is {height} m, but poil.table_height is "
            f"{poil.table_height} m.",
            remedy="Remove poil.safety.posture.table_height; only poil.table_height is used. "
            "To keep the arm farther from the table, raise poil.safety.posture.table_margin.",
        )
    stall, expiry = poil.safety.stall_limit, poil.hardware.command_expiry
    if not stall < expiry:
        raise ScenarioError(
            f"poil.safety.stall_limit is {stall} s, not less than poil.hardware.command_expiry, "
            f"{expiry} s: the driver would stop the arm before the supervisor notices a stall.",
            remedy="Lower stall_limit, or raise command_expiry and the driver's --expire_sec.",
        )


def _check_delays(scenario: Scenario) -> None:
    """Checks that delayed images are not published, and arrive within `poil.latency`."""
    poil = scenario.poil
    for name, camera in scenario.cameras.items():
        if not camera.output_delay > 0.0:
            continue
        bus = scenario.lcm_buses.get(camera.lcm_bus)
        silent = bus is None or bus.lcm_url == NO_NETWORK
        if not silent and (camera.rgb or camera.depth or camera.label):
            raise ScenarioError(
                f"cameras.{name} has an output_delay, so its images cannot be published on "
                f"lcm_buses.{camera.lcm_bus}.",
                remedy="Set the camera's rgb, depth and label to false, or its output_delay to 0.",
            )
        # The tracker reads the images one control period after they appear.
        least = camera.output_delay + poil.rates.control
        if poil.tracker != GROUND_TRUTH and poil.latency < least * (1.0 - _ROUNDING):
            raise ScenarioError(
                f"poil.latency is {poil.latency} s, less than the sum of "
                f"cameras.{name}.output_delay and poil.rates.control, {least:.6g} s.",
                remedy=f"Set poil.latency to at least {least:.6g} s, or reduce the output_delay.",
            )


def _check_buses(scenario: Scenario) -> None:
    """Checks that LCM can use every bus's address, and that every bus in use is defined."""
    for name, params in scenario.lcm_buses.items():
        if params.lcm_url and not _is_lcm_url(params.lcm_url):
            raise ScenarioError(
                f"lcm_buses.{name}.lcm_url is '{params.lcm_url}', which LCM cannot use.",
                remedy="Use e.g. memq://null (no network) or udpm://239.255.76.67:7667?ttl=0.",
            )
    users = {f"cameras.{name}": camera.lcm_bus for name, camera in scenario.cameras.items()}
    users["visualization"] = scenario.visualization.lcm_bus
    for path, bus in users.items():
        if bus not in ("", *scenario.lcm_buses):
            raise ScenarioError(
                f"{path}.lcm_bus is '{bus}', which lcm_buses does not define.",
                remedy=f"Choose one of: {', '.join(scenario.lcm_buses)}.",
            )


def _is_lcm_url(url: str) -> bool:
    """Returns whether LCM can use an address. LCM itself would only print an error."""
    parts = urlsplit(url)
    if parts.scheme not in ("udpm", "mpudpm"):
        return parts.scheme in ("memq", "tcpq", "file")
    try:
        # LCM has a default for an omitted host.
        address = parts.hostname or "239.255.76.67"
        return ipaddress.IPv4Address(address).is_multicast and parts.port != 0
    except ValueError:
        return False
