"""The schema of a scenario: one YAML document that describes a station and a task."""

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
from poil_drake.diagrams.scenario.value_ranges import require_not_negative, require_positive
from poil_drake.systems.panda.velocity_driver import PandaDriver


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
    directives: list[ModelDirective] = field(default_factory=list)
    lcm_buses: Mapping[str, DrakeLcmParams] = field(
        default_factory=lambda: {"default": DrakeLcmParams(lcm_url=checks.NO_NETWORK)}
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
        checks.check_directives(self.directives)
        checks.check_simulator(self.simulator_config)
        checks.check_time_step(self.plant_config, self.poil)
        checks.check_buses(self.lcm_buses, self.cameras, self.visualization)
        checks.check_delays(self.cameras, self.lcm_buses, self.poil)
        checks.check_safety(self.poil)
