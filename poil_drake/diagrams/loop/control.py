"""What moves the arm in the closed loop: propagator, field, inverse kinematics, sequencer."""

import math
from dataclasses import replace

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.straight_motion import StraightMotionConfig
from poil_drake.diagrams.scenario.checks import GROUND_TRUTH
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.station.station import Station
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.control.motion_source import MotionSource, MotionSourceConfig
from poil_drake.systems.control.point_set_bcsdm import PointSetBcsdm, PointSetBcsdmConfig
from poil_drake.systems.ik.arm_plant import MakePandaKinematics
from poil_drake.systems.ik.differential_ik import DifferentialIk, DifferentialIkConfig
from poil_drake.systems.panda.lcm_messages import HAND_PERIOD
from poil_drake.systems.propagation.fk_propagator import FkPropagator
from poil_drake.systems.safety.faults import SafetyConfig
from poil_drake.systems.safety.supervisor import SafetySupervisor
from poil_drake.systems.skill.phases import SkillConfig
from poil_drake.systems.skill.sequencer import SkillSequencer
from poil_drake.systems.skill.stop_requests import StopRequests, StopSwitch

_MISSED_TRACKS = 4
"""Points are carried along by forward kinematics for so many tracker periods."""

_HAND_PERIODS = 3
"""A command to a real hand waits to be sent, to be looked at, and to show in a status."""


def AddControl(
    *,
    builder: DiagramBuilder,
    station: Station,
    plan: ExecutionPlan,
    speed: float = 1.0,
    hardware: bool = False,
    dry_run: bool = False,
    meshcat: Meshcat | None = None,
    stop_switch: StopSwitch | None = None,
    stopwatch: Stopwatch | None,
) -> dict[str, LeafSystem]:
    """Adds the systems of the control path, and returns them by name.

    Args:
        builder: Gets the systems.
        station: The robot.
        plan: What is executed.
        speed: Share of the usual speed at which all motions are made, in (0, 1].
        hardware: Whether it is, or was, a real one.
        dry_run: Whether points are carried along for ever, as they are found only once.
        meshcat: Whose page gets a button that stops the arm.
        stop_switch: What else stops it.
        stopwatch: Where they note how long their updates take, under "control".
    """
    poil = station.scenario.poil
    period = poil.rates.control
    X_WB = station.robot_base_pose()
    kinematics = MakePandaKinematics(X_WB)
    max_age = _MISSED_TRACKS * poil.rates.tracker + poil.latency
    straight = StraightMotionConfig()
    ik = DifferentialIkConfig()
    ik = replace(ik, resolution=replace(ik.resolution, nominal_posture=tuple(plan.nominal_posture)))
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
                **_workspace(X_WB.translation(), poil.table_height),
            ),
        ),
        "inverse_kinematics": DifferentialIk(
            kinematics=kinematics, period=period, config=ik, stopwatch=stopwatch
        ),
        "stop_requests": StopRequests(period=period, meshcat=meshcat, switch=stop_switch),
        "supervisor": SafetySupervisor(
            model=PandaModel(X_WB=X_WB.GetAsMatrix4()),
            limits=kinematics.joint_limits,
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
            config=MotionSourceConfig(
                lift_distance=plan.lift_height,
                retreat_distance=plan.retreat_distance,
                straight=replace(straight, speed=speed * straight.speed),
            ),
            period=period,
        ),
    }
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    return systems


def _skill(plan: ExecutionPlan, speed: float, *, hardware: bool) -> SkillConfig:
    """Returns the plan's, with more time where motions are slower, and for a real hand."""
    usual = SkillConfig()
    return replace(
        usual,
        pregrasp_width=plan.pregrasp_width,
        release_width=plan.pregrasp_width,
        hand_delay=_HAND_PERIODS * HAND_PERIOD if hardware else 0.0,
        goal_patience=usual.goal_patience / speed,
        stuck_time=usual.stuck_time / speed,
        phase_time_limit=usual.phase_time_limit / speed,
    )


def _safety(poil: PoilConfig, speed: float) -> SafetyConfig:
    """Returns the scenario's, with its table and the speed."""
    safety = poil.safety
    limiter = replace(safety.limiter, velocity_scale=speed * safety.limiter.velocity_scale)
    posture = replace(safety.posture, table_height=poil.table_height)
    return replace(safety, limiter=limiter, posture=posture)


def _workspace(p_WB: np.ndarray, table_height: float) -> dict[str, tuple[float, float, float]]:
    """Returns the box in which points are believed, for a robot whose base is at p_WB (3,) [m].

    The Panda reaches 0.855 m, and what it holds somewhat further.
    """
    x, y, z = p_WB.tolist()
    return {
        "workspace_lower": (x - 1.0, y - 1.0, table_height - 0.05),
        "workspace_upper": (x + 1.0, y + 1.0, z + 1.3),
    }
