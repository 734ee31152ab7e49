"""What only a simulation knows of a run: where the object is, and whether it hangs."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from pydrake.systems.framework import Context

from poil_drake.diagrams.run.task_success import HangingJudge, HolderGeometries, TouchedGeometries
from poil_drake.diagrams.station.station import SimulatedStation
from poil_drake.diagrams.station.station_state import GetObjectPose


@dataclass(frozen=True, kw_only=True)
class SimulatedTruth:
    """The truth about the object of a simulated station. Nothing in a loop may depend on it.

    Attributes:
        station: The station.
        judge: Tells whether the object hangs.
    """

    station: SimulatedStation
    judge: HangingJudge

    @classmethod
    def of(cls, station: SimulatedStation) -> Self:
        """Returns the truth about a station."""
        poil = station.scenario.poil
        holder = HolderGeometries(
            station.plant(),
            station.scene_graph().model_inspector(),
            poil.fixture,
            poil.demonstration_motion.hanging.rod,
        )
        return cls(station=station, judge=HangingJudge(fixture=poil.fixture, holder=holder))

    def object_pose(self, root: Context) -> np.ndarray:
        """Returns X_WO (4, 4), the pose of the object's base body, from the root context."""
        context = self.station.GetMyContextFromRoot(root)
        return GetObjectPose(self.station, context).GetAsMatrix4()

    def judge_now(self, root: Context) -> None:
        """Lets the judge see what the object touches."""
        station = self.station
        context = station.GetMyContextFromRoot(root)
        touched = TouchedGeometries(
            station.plant(),
            station.GetOutputPort("query_object").Eval(context).inspector(),
            station.GetOutputPort("contact_results").Eval(context),
            station.scenario.poil.object,
        )
        self.judge.observe(root.get_time(), touched)
