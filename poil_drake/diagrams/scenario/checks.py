"""Checks that compare several keys of a scenario, or that Drake makes late or not at all."""

import ipaddress
from collections.abc import Mapping, Sequence
from urllib.parse import urlsplit

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

GROUND_TRUTH = "ground_truth"
"""The name of the baseline tracker, which uses the simulator's true poses instead of images."""

NO_NETWORK = "memq://null"
"""The address of an LCM network that carries nothing."""

DRAKE_ERRORS = (RuntimeError, ValueError, TypeError, SystemExit)
"""What Drake raises for invalid values. A failed C++ assertion arrives in Python as SystemExit."""

_ROUNDING = 1e-9  # Relative rounding error of decimal numbers.


def check_directives(directives: Sequence[ModelDirective]) -> None:
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


def check_simulator(config: SimulatorConfig) -> None:
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


def check_time_step(config: MultibodyPlantConfig, poil: PoilConfig) -> None:
    """Checks that `plant_config.time_step` does not contradict `poil.rates.plant`."""
    # An omitted key has Drake's default.
    if config.time_step not in (poil.rates.plant, MultibodyPlantConfig().time_step):
        raise ScenarioError(
            f"plant_config.time_step is {config.time_step} s, but poil.rates.plant is "
            f"{poil.rates.plant} s.",
            remedy="Remove plant_config.time_step; only poil.rates.plant is used.",
        )


def check_safety(poil: PoilConfig) -> None:
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


def check_delays(
    cameras: Mapping[str, CameraConfig],
    lcm_buses: Mapping[str, DrakeLcmParams],
    poil: PoilConfig,
) -> None:
    """Checks that delayed images are not published, and arrive within `poil.latency`."""
    for name, camera in cameras.items():
        if not camera.output_delay > 0.0:
            continue
        bus = lcm_buses.get(camera.lcm_bus)
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


def check_buses(
    lcm_buses: Mapping[str, DrakeLcmParams],
    cameras: Mapping[str, CameraConfig],
    visualization: VisualizationConfig,
) -> None:
    """Checks that LCM can use every bus's address, and that every bus in use is defined."""
    for name, params in lcm_buses.items():
        if params.lcm_url and not _is_lcm_url(params.lcm_url):
            raise ScenarioError(
                f"lcm_buses.{name}.lcm_url is '{params.lcm_url}', which LCM cannot use.",
                remedy="Use e.g. memq://null (no network) or udpm://239.255.76.67:7667?ttl=0.",
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


def drake_reason(error: BaseException) -> str:
    """Returns the text of an error on one line, without a final full stop."""
    reason = " ".join(str(error).split())
    # An assertion: "Failure at <file>:<line> in <function>: condition '<C++>' failed."
    if reason.startswith("Failure at ") and ": condition " in reason:
        reason = "Drake requires " + reason.split(": condition ", 1)[1].removesuffix(" failed.")
    return reason.rstrip(".")
