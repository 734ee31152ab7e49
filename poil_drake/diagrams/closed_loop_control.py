"""What moves the arm in the closed loop: propagator, field, inverse kinematics, sequencer."""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.control.point_set_bcsdm import BcsdmConfig
from poil_drake.diagrams.station import Station
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.systems.arm_plant import MakePandaKinematics
from poil_drake.systems.differential_ik import DifferentialIk, DifferentialIkConfig
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.motion_source import MotionSource, MotionSourceConfig
from poil_drake.systems.point_set_bcsdm import PointSetBcsdm, PointSetBcsdmConfig
from poil_drake.systems.skill_phases import SkillConfig
from poil_drake.systems.skill_sequencer import SkillSequencer
from poil_drake.systems.stopwatch import Stopwatch

_MISSED_TRACKS = 4
"""Points are carried along by forward kinematics for so many tracker periods."""


def AddControl(
    *,
    builder: DiagramBuilder,
    station: Station,
    plan: ExecutionPlan,
    stopwatch: Stopwatch | None,
) -> dict[str, LeafSystem]:
    """Adds the systems of the control path, and returns them by name.

    Args:
        builder: Gets the systems.
        station: The robot.
        plan: What is executed.
        stopwatch: Where they note how long their updates take, under "control".
    """
    poil = station.scenario.poil
    period = poil.rates.control
    X_WB = station.robot_base_pose()
    kinematics = MakePandaKinematics(X_WB)
    ik = DifferentialIkConfig()
    ik = replace(ik, resolution=replace(ik.resolution, nominal_posture=tuple(plan.nominal_posture)))
    systems = {
        "propagator": FkPropagator(
            num_points=len(plan.target_points),
            kinematics=kinematics,
            period=period,
            max_age=_MISSED_TRACKS * poil.rates.tracker + poil.latency,
            stopwatch=stopwatch,
        ),
        "controller": PointSetBcsdm(
            reference=plan.reference,
            period=period,
            config=PointSetBcsdmConfig(
                bcsdm=BcsdmConfig(eta=poil.eta),
                max_angular_speed=poil.max_angular_speed,
                max_linear_speed=poil.max_linear_speed,
                **_workspace(X_WB.translation(), poil.table_height),
            ),
        ),
        "inverse_kinematics": DifferentialIk(
            kinematics=kinematics, period=period, config=ik, stopwatch=stopwatch
        ),
        "sequencer": SkillSequencer(
            config=SkillConfig(
                pregrasp_width=plan.pregrasp_width, release_width=plan.pregrasp_width
            ),
            period=period,
            stopwatch=stopwatch,
        ),
        "motion": MotionSource(
            approach=plan.approach,
            descent=plan.descent,
            config=MotionSourceConfig(
                lift_distance=plan.lift_height, retreat_distance=plan.retreat_distance
            ),
            period=period,
        ),
    }
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    return systems


def _workspace(p_WB: np.ndarray, table_height: float) -> dict[str, tuple[float, float, float]]:
    """Returns the box in which points are believed, for a robot whose base is at p_WB (3,) [m].

    The Panda reaches 0.855 m, and what it holds somewhat further.
    """
    x, y, z = p_WB.tolist()
    return {
        "workspace_lower": (x - 1.0, y - 1.0, table_height - 0.05),
        "workspace_upper": (x + 1.0, y + 1.0, z + 1.3),
    }
