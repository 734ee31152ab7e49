"""What can be wrong with a scenario's values before anything is built."""

import ipaddress
import math
from collections.abc import Mapping, Sequence
from urllib.parse import urlsplit

from pydrake.lcm import DrakeLcmParams
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.sensors import CameraConfig
from pydrake.visualization import VisualizationConfig

from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import ScenarioError
from poil_drake.robots.posture_guard import PostureGuardConfig

GROUND_TRUTH = "ground_truth"
"""The tracker's name that stands for the simulator's own poses: a labelled baseline."""

NO_NETWORK = "memq://null"
"""The address of an LCM network that carries nothing."""

_ROUNDING = 1e-9  # of what is written in decimals
_MULTICAST_SCHEMES = ("udpm", "mpudpm")
_OTHER_SCHEMES = ("memq", "tcpq", "file")

# "cenic" integrates the plant as a continuous system, which ours is not.
_INTEGRATION_SCHEMES = (
    "bogacki_shampine3",
    "explicit_euler",
    "implicit_euler",
    "radau1",
    "radau3",
    "runge_kutta2",
    "runge_kutta3",
    "runge_kutta5",
    "semi_explicit_euler",
    "velocity_implicit_euler",
)


def require_positive(name: str, value: float, *, infinite: bool = False) -> None:
    """Rejects non-positive values, and infinity unless it is allowed."""
    if not value > 0.0 or (math.isinf(value) and not infinite):
        raise ScenarioError(
            f"{name} is {value}.",
            remedy="It must be positive." if infinite else "It must be positive and finite.",
        )


def check_directives(directives: Sequence[ModelDirective]) -> None:
    """Checks that each directive says one thing, completely."""
    for index, directive in enumerate(directives):
        _check_directive(directive, f"directives[{index}]")


def _check_directive(directive: ModelDirective, path: str) -> None:
    fields = {f.name: getattr(directive, f.name) for f in directive.__fields__}
    given = [name for name, value in fields.items() if value is not None]
    if len(given) != 1:
        raise ScenarioError(
            f"'{path}' holds {' and '.join(given) or 'nothing'}.",
            remedy=f"Begin each directive with a dash of its own, and one of: {', '.join(fields)}.",
        )
    directive_ = fields[given[0]]
    for key in ("name", "file", "parent", "child"):
        if getattr(directive_, key, None) == "":
            raise ScenarioError(
                f"'{path}.{given[0]}' has no '{key}'.", remedy=f"Add '{key}: ...' to it."
            )


def check_simulator(config: SimulatorConfig) -> None:
    """Checks the values that Drake would not, or only later."""
    path = "simulator_config"
    require_positive(f"{path}.max_step_size", config.max_step_size)
    require_positive(f"{path}.accuracy", config.accuracy)
    if config.integration_scheme not in _INTEGRATION_SCHEMES:
        raise ScenarioError(
            f"{path}.integration_scheme is '{config.integration_scheme}'.",
            remedy=f"Choose one of: {', '.join(_INTEGRATION_SCHEMES)}.",
        )
    if not 0.0 <= config.target_realtime_rate < math.inf:
        raise ScenarioError(
            f"{path}.target_realtime_rate is {config.target_realtime_rate}.",
            remedy="It must be finite and not negative; 0 runs as fast as it can.",
        )
    if config.start_time != 0.0:
        raise ScenarioError(
            f"{path}.start_time is {config.start_time} s, but every run starts at 0.",
            remedy="Leave it out.",
        )


def check_time_step(config: MultibodyPlantConfig, poil: PoilConfig) -> None:
    """Checks that the plant's period is not given twice, differently."""
    step, plant = config.time_step, poil.rates.plant
    # Drake's default is what an unset field holds.
    if step not in (plant, MultibodyPlantConfig().time_step):
        raise ScenarioError(
            f"plant_config.time_step is {step} s, but poil.rates.plant is {plant} s.",
            remedy="Leave the first out; the second is what counts.",
        )


def check_safety(poil: PoilConfig) -> None:
    """Checks that the supervisor's limits agree with the rest of the stanza."""
    height = poil.safety.posture.table_height
    if height not in (poil.table_height, PostureGuardConfig().table_height):
        raise ScenarioError(
            f"poil.safety.posture.table_height is {height}, but poil.table_height is "
            f"{poil.table_height}.",
            remedy="Leave the first out; the second is what counts. What more is to be kept from "
            "the table is poil.safety.posture.table_margin.",
        )
    stall, expiry = poil.safety.stall_limit, poil.hardware.command_expiry
    if not stall < expiry:
        raise ScenarioError(
            f"poil.safety.stall_limit is {stall} s, and poil.hardware.command_expiry {expiry} s: "
            "the driver would stop the arm before the supervisor knew of it.",
            remedy="Make the first smaller, and the second the driver's --expire_sec.",
        )


def check_delays(
    cameras: Mapping[str, CameraConfig],
    lcm_buses: Mapping[str, DrakeLcmParams],
    poil: PoilConfig,
) -> None:
    """Checks that delayed images are not published, and that the latency covers the delay."""
    for name, camera in cameras.items():
        if not camera.output_delay > 0.0:
            continue
        bus = lcm_buses.get(camera.lcm_bus)
        silent = bus is None or bus.lcm_url == NO_NETWORK
        if not silent and (camera.rgb or camera.depth or camera.label):
            raise ScenarioError(
                f"cameras.{name} has an output_delay and is published on "
                f"lcm_buses.{camera.lcm_bus}.",
                remedy="Delayed images are not published: set its rgb, depth and label to false, "
                "or its output_delay to 0.",
            )
        # The tracker looks one control period after the images have appeared.
        least = camera.output_delay + poil.rates.control
        if poil.tracker != GROUND_TRUTH and poil.latency < least * (1.0 - _ROUNDING):
            raise ScenarioError(
                f"poil.latency is {poil.latency} s, but cameras.{name}.output_delay is "
                f"{camera.output_delay} s.",
                remedy=f"poil.latency holds the cameras' delay: make it at least {least:.6g} s, or "
                "the delay shorter.",
            )


def check_buses(
    lcm_buses: Mapping[str, DrakeLcmParams],
    cameras: Mapping[str, CameraConfig],
    visualization: VisualizationConfig,
) -> None:
    """Checks that LCM can use the buses' addresses, and that those in use are defined."""
    for name, params in lcm_buses.items():
        if params.lcm_url and not _is_lcm_url(params.lcm_url):
            raise ScenarioError(
                f"lcm_buses.{name}.lcm_url is '{params.lcm_url}'.",
                remedy="Write e.g. memq://null (no network) or udpm://239.255.76.67:7667?ttl=0.",
            )
    users = {f"cameras.{name}": camera.lcm_bus for name, camera in cameras.items()}
    users["visualization"] = visualization.lcm_bus
    for path, bus in users.items():
        if bus not in ("", *lcm_buses):
            raise ScenarioError(
                f"{path}.lcm_bus is '{bus}', which lcm_buses does not define.",
                remedy=f"Choose one of: {', '.join(lcm_buses)}.",
            )


def _is_lcm_url(url: str) -> bool:
    """Returns whether LCM can use an address; it would only print that it cannot."""
    parts = urlsplit(url)
    if parts.scheme not in _MULTICAST_SCHEMES:
        return parts.scheme in _OTHER_SCHEMES
    try:
        # An empty one stands for LCM's defaults.
        address = parts.hostname or "239.255.76.67"
        return ipaddress.IPv4Address(address).is_multicast and parts.port != 0
    except ValueError:
        return False
