"""The pure function that watches for what stops the arm."""

import math
from typing import NamedTuple

from poil_drake.systems.safety.faults import SafetyConfig, SafetyFault
from poil_drake.systems.statuses import RobotMode


class SafetyObservation(NamedTuple):
    """What the supervisor sees at one control tick.

    Attributes:
        mode: The `RobotMode`.
        status_age: Our clock minus the stamp of the newest status [s].
        success_rate: Share of commands that reach the robot in time.
        position_known: Whether the measured position is finite.
        torque_ratio: Largest external torque as a multiple of what is allowed; NaN if unknown.
        tracking_error: Largest difference of commanded and measured positions [rad]; zero while
            the arm stands, wherever that is, and NaN before something is commanded.
        standing: Whether the arm stands, as commanded and as measured.
        command_finite: Whether the wanted velocity is finite.
        command_age: How long ago it was computed [s]: infinity before the first one; zero where
            that is not told.
        image_age: Age of the oldest camera's image [s]; zero without any.
        image_ahead: How far the newest camera's image is in the future [s]; zero without any.
        stalled: How long the last update is ago by the clock [s]; zero where that is not told.
        stops: Stop requests so far.
        resets: Reset requests so far.
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
    """The watch's memory; all floats, so that it fits a discrete state vector.

    Attributes:
        fault: The latched `SafetyFault`.
        seen: 1 once a status has arrived.
        believed: 1 while the robot's status is fresh.
        last_age: Age of the status at the last tick [s]; NaN before the first.
        silent_for: How long no newer status came [s].
        off_for: How long the statuses have been off our clock [s].
        rate_low_for: How long the success rate has been too low [s].
        torque_high_for: How long an external torque has been too large [s].
        commanded: 1 once a velocity was computed.
        stops: Stop requests at the last tick.
        resets: Reset requests at the last tick.
    """

    fault: float = float(SafetyFault.NONE)
    seen: float = 0.0
    believed: float = 0.0
    last_age: float = math.nan
    silent_for: float = 0.0
    off_for: float = 0.0
    rate_low_for: float = 0.0
    torque_high_for: float = 0.0
    commanded: float = 0.0
    stops: float = 0.0
    resets: float = 0.0


# Looking a member up in its class takes longer than the comparison.
_NO_FAULT = SafetyFault.NONE
_MOVE = float(RobotMode.MOVE)


def watch(
    memory: SafetyMemory, seen: SafetyObservation, config: SafetyConfig, period: float
) -> SafetyMemory:
    """Returns the memory after one control tick, with a fault if there is a reason for one.

    A fault stays until `resets` grows while the arm stands and nothing is wrong any more. A reset
    that comes too early does nothing. Before the first status only a stop is a fault.

    Args:
        memory: The memory before.
        seen: What is observed now.
        config: Thresholds and times.
        period: The control period [s].
    """
    stopped = not seen.stops <= memory.stops  # A NaN stops, too.
    reset = seen.resets > memory.resets
    after = _remember(memory, seen, config, period)
    cause = SafetyFault.STOP_REQUESTED if stopped else _cause(after, seen, config)
    if not memory.fault:
        return after._replace(fault=float(cause))
    gone = cause is _NO_FAULT and (after.believed or not after.seen)
    if reset and gone and seen.standing:
        return after._replace(fault=float(_NO_FAULT))
    return after


def _remember(
    memory: SafetyMemory, seen: SafetyObservation, config: SafetyConfig, period: float
) -> SafetyMemory:
    age = seen.status_age
    known = math.isfinite(age)
    arrived = bool(memory.seen) or known
    on_time = abs(age) <= config.status_age_limit
    believed = arrived and on_time and seen.position_known
    # The age grows as time goes by, and drops when a newer status comes.
    silent = age - memory.last_age > 0.5 * period
    rate_low = believed and not seen.success_rate >= config.min_success_rate
    torque_high = believed and not seen.torque_ratio <= 1.0
    # Made whole: `_replace` takes twice as long.
    return SafetyMemory(
        fault=memory.fault,
        seen=float(arrived),
        believed=float(believed),
        last_age=age if known else memory.last_age,
        silent_for=memory.silent_for + period if silent else 0.0,
        off_for=memory.off_for + period if arrived and not on_time else 0.0,
        rate_low_for=memory.rate_low_for + period if rate_low else 0.0,
        torque_high_for=memory.torque_high_for + period if torque_high else 0.0,
        commanded=float(memory.commanded or seen.command_age < math.inf),
        stops=memory.stops if math.isnan(seen.stops) else seen.stops,
        resets=memory.resets if math.isnan(seen.resets) else seen.resets,
    )


def _cause(memory: SafetyMemory, seen: SafetyObservation, config: SafetyConfig) -> SafetyFault:
    """Returns what is wrong now, the gravest first."""
    if not memory.seen:
        return _NO_FAULT
    if seen.stalled > config.stall_limit:
        return SafetyFault.LOOP_STALLED
    if not memory.believed:
        return _status_fault(memory, seen, config)
    if seen.mode != _MOVE:
        return SafetyFault.ROBOT_MODE
    if memory.torque_high_for > config.external_torque_time:
        return SafetyFault.EXTERNAL_TORQUE
    if seen.tracking_error > config.tracking_leash:
        return SafetyFault.TRACKING_ERROR
    if memory.rate_low_for > config.success_rate_time:
        return SafetyFault.SUCCESS_RATE
    if not seen.command_finite:
        return SafetyFault.COMMAND_NOT_FINITE
    if memory.commanded and not seen.command_age <= config.command_age_limit:
        return SafetyFault.COMMAND_STALE
    if seen.image_age > config.image_age_limit:
        return SafetyFault.CAMERA_STALE
    if seen.image_ahead > config.image_ahead_limit:
        return SafetyFault.CAMERA_CLOCK
    return _NO_FAULT


def _status_fault(
    memory: SafetyMemory, seen: SafetyObservation, config: SafetyConfig
) -> SafetyFault:
    """Tells a driver that fell silent from one whose clock is off.

    The age of the status of a silent driver grows as time goes by, that by a wrong clock stays.
    Where the age leaps, what it does afterwards decides, and there is no fault yet: the leap may
    have been a delay of our own.
    """
    if not math.isfinite(seen.status_age) or not seen.position_known:
        return SafetyFault.NO_STATUS
    patience = 0.5 * config.status_age_limit
    if memory.silent_for >= patience:
        return SafetyFault.NO_STATUS
    if memory.off_for >= patience:
        off = seen.status_age < 0.0 or seen.status_age >= config.clock_off_age
        return SafetyFault.CLOCK_OFF if off else SafetyFault.NO_STATUS
    return _NO_FAULT
