"""The supervisor's fault detection, as a pure function."""

import math
from typing import NamedTuple

from poil_drake.systems.safety.faults import SafetyConfig, SafetyFault
from poil_drake.systems.statuses import RobotMode


class SafetyObservation(NamedTuple):
    """The supervisor's observations in one control period.

    Attributes:
        mode: The `RobotMode`.
        status_age: Age of the newest status [s]; negative if its stamp is in the future.
        success_rate: Share of commands that reach the robot in time.
        position_known: Whether the measured position is finite.
        torque_ratio: Largest external torque as a multiple of its limit; NaN if unknown.
        tracking_error: Largest difference between commanded and measured positions [rad]; zero
            while the arm is at rest, and NaN before the first command.
        standing: Whether the arm is at rest, both as commanded and as measured.
        command_finite: Whether the desired velocity is finite.
        command_age: Age of the desired velocity [s]: infinity before the first one; zero if
            `velocity_time` is not connected.
        image_age: Largest age of any camera's newest image [s]; zero without images.
        image_ahead: How far the newest stamp of an image is in the future [s]; zero if it is not.
        stalled: Time since the last update by the clock [s]; zero without a clock.
        stops: Number of stop requests.
        resets: Number of reset requests.
    """

    mode: float
    status_age: float
    success_rate: float
    position_known: bool
    torque_ratio: float
    tracking_error: float
    standing: bool
    command_finite: bool
    command_age: float
    image_age: float
    image_ahead: float
    stalled: float
    stops: float
    resets: float


class SafetyMemory(NamedTuple):
    """The memory of `watch`; all floats, so that it fits a discrete state vector.

    Attributes:
        fault: The latched `SafetyFault`.
        received: 1 once a status has arrived.
        fresh: 1 while the robot's status is fresh.
        last_age: Age of the status in the last period [s]; NaN before the first status.
        silent_for: How long no newer status has arrived [s].
        off_for: How long the absolute age of the status has exceeded its limit [s].
        rate_low_for: How long the success rate has been below its limit [s].
        torque_high_for: How long an external torque has been above its limit [s].
        commanded: 1 once the controller has computed a velocity.
        stops: Number of stop requests up to the last period.
        resets: Number of reset requests up to the last period.
    """

    fault: float = float(SafetyFault.NONE)
    received: float = 0.0
    fresh: float = 0.0
    last_age: float = math.nan
    silent_for: float = 0.0
    off_for: float = 0.0
    rate_low_for: float = 0.0
    torque_high_for: float = 0.0
    commanded: float = 0.0
    stops: float = 0.0
    resets: float = 0.0


def watch(
    memory: SafetyMemory, observation: SafetyObservation, config: SafetyConfig, period: float
) -> SafetyMemory:
    """Returns the memory after one control period, with a fault if there is a cause.

    A fault stays until `resets` grows while the arm is at rest and no cause persists; an earlier
    reset has no effect. Before the first status, only a stop request causes a fault.

    Args:
        memory: The memory after the last period.
        observation: The current observation.
        config: Thresholds and times.
        period: The control period [s].
    """
    stopped = not observation.stops <= memory.stops  # A NaN stops, too.
    reset = observation.resets > memory.resets
    after = _remember(memory, observation, config, period)
    cause = SafetyFault.STOP_REQUESTED if stopped else _cause(after, observation, config)
    if not memory.fault:
        return after._replace(fault=float(cause))
    gone = cause is SafetyFault.NONE and (after.fresh or not after.received)
    if reset and gone and observation.standing:
        return after._replace(fault=float(SafetyFault.NONE))
    return after


def _remember(
    memory: SafetyMemory, observation: SafetyObservation, config: SafetyConfig, period: float
) -> SafetyMemory:
    age = observation.status_age
    known = math.isfinite(age)
    received = bool(memory.received) or known
    on_time = abs(age) <= config.status_age_limit
    fresh = received and on_time and observation.position_known
    # The age grows with time, and drops with each newer status.
    silent = age - memory.last_age > 0.5 * period
    rate_low = fresh and not observation.success_rate >= config.min_success_rate
    torque_high = fresh and not observation.torque_ratio <= 1.0
    return SafetyMemory(
        fault=memory.fault,
        received=float(received),
        fresh=float(fresh),
        last_age=age if known else memory.last_age,
        silent_for=memory.silent_for + period if silent else 0.0,
        off_for=memory.off_for + period if received and not on_time else 0.0,
        rate_low_for=memory.rate_low_for + period if rate_low else 0.0,
        torque_high_for=memory.torque_high_for + period if torque_high else 0.0,
        commanded=float(memory.commanded or observation.command_age < math.inf),
        stops=memory.stops if math.isnan(observation.stops) else observation.stops,
        resets=memory.resets if math.isnan(observation.resets) else observation.resets,
    )


def _cause(
    memory: SafetyMemory, observation: SafetyObservation, config: SafetyConfig
) -> SafetyFault:
    """Returns the most severe fault whose cause is present, or NONE."""
    if not memory.received:
        return SafetyFault.NONE
    if observation.stalled > config.stall_limit:
        return SafetyFault.LOOP_STALLED
    if not memory.fresh:
        return _status_fault(memory, observation, config)
    command_old = not observation.command_age <= config.command_age_limit
    causes = {
        SafetyFault.ROBOT_MODE: observation.mode != RobotMode.MOVE,
        SafetyFault.EXTERNAL_TORQUE: memory.torque_high_for > config.external_torque_time,
        SafetyFault.TRACKING_ERROR: observation.tracking_error > config.tracking_leash,
        SafetyFault.SUCCESS_RATE: memory.rate_low_for > config.success_rate_time,
        SafetyFault.COMMAND_NOT_FINITE: not observation.command_finite,
        SafetyFault.COMMAND_STALE: bool(memory.commanded) and command_old,
        SafetyFault.CAMERA_STALE: observation.image_age > config.image_age_limit,
        SafetyFault.CAMERA_CLOCK: observation.image_ahead > config.image_ahead_limit,
    }
    return next((fault for fault, present in causes.items() if present), SafetyFault.NONE)


def _status_fault(
    memory: SafetyMemory, observation: SafetyObservation, config: SafetyConfig
) -> SafetyFault:
    """Returns the fault of a status that is not fresh: NO_STATUS, CLOCK_OFF, or NONE so far.

    If the driver is silent, the age of its status grows with time; if its clock is off, the age
    stays constant. A single jump of the age is no fault yet, because a delay of this process may
    have caused the jump.
    """
    if not math.isfinite(observation.status_age) or not observation.position_known:
        return SafetyFault.NO_STATUS
    patience = 0.5 * config.status_age_limit
    if memory.silent_for >= patience:
        return SafetyFault.NO_STATUS
    if memory.off_for >= patience:
        age = observation.status_age
        off = age < 0.0 or age >= config.clock_off_age
        return SafetyFault.CLOCK_OFF if off else SafetyFault.NO_STATUS
    return SafetyFault.NONE
