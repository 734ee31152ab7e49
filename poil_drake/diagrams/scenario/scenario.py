"""The scenario schema: what one YAML document says about a station and a task."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from pydrake.lcm import DrakeLcmParams
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.sensors import CameraConfig
from pydrake.visualization import VisualizationConfig

from poil_drake.diagrams.scenario import checks
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import ScenarioError
from poil_drake.systems.panda.velocity_driver import PandaDriver


def _null_lcm() -> dict[str, DrakeLcmParams]:
    return {"default": DrakeLcmParams(lcm_url=checks.NO_NETWORK)}


def _simulator_config() -> SimulatorConfig:
    return SimulatorConfig(max_step_size=0.01, use_error_control=False, accuracy=1e-2)


def _plant_config() -> MultibodyPlantConfig:
    # "sap" softens the contact of the light fingers so much that a held mug tilts; "lagged" not.
    return MultibodyPlantConfig(
        contact_model="hydroelastic_with_fallback", discrete_contact_approximation="lagged"
    )


def _visualization_config() -> VisualizationConfig:
    return VisualizationConfig(
        publish_period=1 / 32,
        publish_contacts=False,
        publish_inertia=False,
        enable_meshcat_creation=False,
    )


@dataclass(frozen=True, kw_only=True)
class ScenarioSource:
    """Where a scenario was read.

    Attributes:
        name: Which document of the file; empty if there was no file.
        file: The file; empty if there was none.
    """

    name: str = ""
    file: str = ""


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Everything that builds a station and its task; the keys are those of Drake's hardware_sim.

    Attributes:
        random_seed: Seeds all noise.
        simulation_duration: Longest run [s].
        simulator_config: Drake's simulator settings. `target_realtime_rate` slows a run down,
            unless the command line says otherwise. All reach the simulator, but every system here
            is discrete, so there is nothing to integrate: `integration_scheme`, `max_step_size`,
            `accuracy` and `use_error_control` change no run, and `start_time` stays 0.
        plant_config: Drake's plant settings, except `time_step`: that is `poil.rates.plant`.
        directives: The models: files, welds, default poses. A file may be `package://...`,
            `file://...`, or a path relative to the scenario file.
        lcm_buses: LCM networks; by default none is opened.
        model_drivers: Model instance -> how its commands are followed.
        cameras: Name -> camera. Its `rgb`, `depth`, `label` and `fps` only say what is published on
            its LCM bus: here every camera gives all images, whenever somebody looks. With an
            `output_delay` [s], the same for all, images are captured at the tracker's rate and
            appear that much later; a process of its own renders them beside the simulation, and
            none is published.
        visualization: What Meshcat shows.
        initial_position: Model instance -> joint -> position [rad or m].
        poil: The task, and how POIL does it.
        source: Where the loader found it; no key of the file.
    """

    random_seed: int = 0
    simulation_duration: float = math.inf
    simulator_config: SimulatorConfig = field(default_factory=_simulator_config)
    plant_config: MultibodyPlantConfig = field(default_factory=_plant_config)
    directives: list[ModelDirective] = field(default_factory=list)
    lcm_buses: Mapping[str, DrakeLcmParams] = field(default_factory=_null_lcm)
    model_drivers: Mapping[str, PandaDriver] = field(default_factory=dict)
    cameras: Mapping[str, CameraConfig] = field(default_factory=dict)
    visualization: VisualizationConfig = field(default_factory=_visualization_config)
    initial_position: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    poil: PoilConfig = field(default_factory=PoilConfig)
    source: ScenarioSource = field(default_factory=ScenarioSource, metadata={"yaml": False})

    def __post_init__(self) -> None:
        if self.random_seed < 0:
            raise ScenarioError(
                f"random_seed is {self.random_seed}.", remedy="It must be 0 or a positive number."
            )
        checks.require_positive("simulation_duration", self.simulation_duration, infinite=True)
        checks.require_positive("visualization.publish_period", self.visualization.publish_period)
        checks.check_directives(self.directives)
        checks.check_simulator(self.simulator_config)
        checks.check_time_step(self.plant_config, self.poil)
        checks.check_buses(self.lcm_buses, self.cameras, self.visualization)
        checks.check_delays(self.cameras, self.lcm_buses, self.poil)
        checks.check_safety(self.poil)
