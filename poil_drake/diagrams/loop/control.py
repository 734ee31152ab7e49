"""The control path of the closed loop, from the propagator to the supervisor and the sequencer."""

import math
from dataclasses import replace

from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.straight_motion import StraightMotionConfig
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH
from poil_drake.diagrams.station.station import Station
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.control.motion_source import MotionSource
from poil_drake.systems.control.point_set_bcsdm import PointSetBcsdm, PointSetBcsdmConfig
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.ik.arm_kinematics import MakePandaKinematics
from poil_drake.systems.ik.differential_ik import (
    DifferentialInverseKinematics,
    DifferentialInverseKinematicsConfig,
)
from poil_drake.systems.lcm.panda_messages import HAND_PERIOD
from poil_drake.systems.safety.faults import SafetyConfig
from poil_drake.systems.safety.supervisor import SafetySupervisor
from poil_drake.systems.skill.sequencer import SkillSequencer
from poil_drake.systems.skill.state_machine import SkillConfig
from poil_drake.systems.skill.stop_requests import StopRequests, StopSwitch

_MISSED_TRACKS = 4
"""The propagator bridges this many missed periods of the tracker."""

_HAND_PERIODS = 3
"""The effect of a command to a real hand is known after this many of the hand's periods: one until
it is sent, one until it is read, and one until a status reports the result."""


def AddControl(
    *,
    builder: DiagramBuilder,
    station: Station,
    plan: ExecutionPlan,
    speed: float,
    hardware: bool,
    dry_run: bool,
    meshcat: Meshcat | None,
    stop_switch: StopSwitch | None,
    stopwatch: Stopwatch | None,
) -> dict[str, LeafSystem]:
    """Adds the systems of the control path, and returns them by name.

    Args:
        builder: Receives the systems.
        station: The station with the robot.
        plan: The plan to execute.
        speed: Factor on the speed of all motions, in (0, 1].
        hardware: Whether the station is a real robot, or replays a run of one.
        dry_run: Whether this is a dry run. The tracker then finds the points only once, and they
            never expire.
        meshcat: The page that gets a button to stop the arm.
        stop_switch: Another source of stop requests.
        stopwatch: Measures the time for the systems' updates, as "control".
    """
    poil = station.scenario.poil
    period = poil.rates.control
    X_WB = station.robot_base_pose()
    x, y, z = X_WB.translation().tolist()
    kinematics = MakePandaKinematics(X_WB)
    max_age = _MISSED_TRACKS * poil.rates.tracker + poil.latency
    straight = StraightMotionConfig()
    systems = {
        "propagator": FkPropagator(
            num_points=len(plan.target_points),
            kinematics=kinematics,
            period=period,
            max_age=math.inf if dry_run else max_age,
            history=max_age,
            stopwatch=stopwatch,
        ),
        "controller": PointSetBcsdm(
            reference=plan.reference,
            period=period,
            config=PointSetBcsdmConfig(
                bcsdm=BcsdmConfig(eta=poil.eta),
                max_angular_speed=speed * poil.max_angular_speed,
                max_linear_speed=speed * poil.max_linear_speed,
                # The Panda reaches 0.855 m, and the object that it holds somewhat farther.
                workspace_lower=(x - 1.0, y - 1.0, poil.table_height - 0.05),
                workspace_upper=(x + 1.0, y + 1.0, z + 1.3),
            ),
        ),
        "inverse_kinematics": DifferentialInverseKinematics(
            kinematics=kinematics,
            period=period,
            config=DifferentialInverseKinematicsConfig(nominal_posture=tuple(plan.nominal_posture)),
            stopwatch=stopwatch,
        ),
        "stop_requests": StopRequests(period=period, meshcat=meshcat, switch=stop_switch),
        "supervisor": SafetySupervisor(
            model=PandaModel(X_WB=X_WB.GetAsMatrix4()),
            period=period,
            cameras=[] if poil.tracker == GROUND_TRUTH else station.camera_names,
            config=_safety(poil, speed),
            clock=station.clock,
            command_expiry=poil.hardware.command_expiry,
            stopwatch=stopwatch,
        ),
        "sequencer": SkillSequencer(
            config=_skill(plan, speed, hardware=hardware),
            period=period,
            stopwatch=stopwatch,
        ),
        "motion": MotionSource(
            approach=plan.approach.slowed(speed),
            descent=plan.descent.slowed(speed),
            lift_distance=plan.lift_height,
            retreat_distance=plan.retreat_distance,
            straight=replace(straight, speed=speed * straight.speed),
            period=period,
        ),
    }
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    return systems


def _skill(plan: ExecutionPlan, speed: float, *, hardware: bool) -> SkillConfig:
    """Returns the skill's parameters, with more time for slower motions and for a real hand."""
    default = SkillConfig()
    return replace(
        default,
        open_width=plan.pregrasp_width,
        hand_delay=_HAND_PERIODS * HAND_PERIOD if hardware else 0.0,
        goal_patience=default.goal_patience / speed,
        stuck_time=default.stuck_time / speed,
        phase_time_limit=default.phase_time_limit / speed,
    )


def _safety(poil: PoilConfig, speed: float) -> SafetyConfig:
    """Returns the safety parameters with the scenario's table height and scaled speed limits."""
    safety = poil.safety
    limiter = replace(safety.limiter, velocity_scale=speed * safety.limiter.velocity_scale)
    posture = replace(safety.posture, table_height=poil.table_height)
    return replace(safety, limiter=limiter, posture=posture)
