"""Outputs the positions of a whole plant of which only the robot is measured."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from poil_drake.robots.panda import NUM_JOINTS


class MeasuredPosture(LeafSystem):
    """Outputs a plant's positions: the robot's as measured, all others at their defaults.

    .. pydrake_system::

        name: MeasuredPosture
        input_ports:
        - position_measured
        - width_measured
        output_ports:
        - positions

    `position_measured` (7,) [rad] holds the arm's joint positions, `width_measured` (1,) [m] the
    hand's opening, and `positions` (nq,) the plant's generalized positions. While an input is not
    finite, as before the first message, the arm or the fingers are at their default positions.
    """

    def __init__(self, *, plant: MultibodyPlant, robot: ModelInstanceIndex):
        """Constructs the system.

        Args:
            plant: The plant.
            robot: The model instance of the Panda with its hand.
        """
        super().__init__()
        self._plant, self._robot = plant, robot
        context = plant.CreateDefaultContext()
        self._default = plant.GetPositions(context)
        self._robot_default = plant.GetPositions(context, robot)
        self._arm = self.DeclareVectorInputPort("position_measured", NUM_JOINTS)
        self._hand = self.DeclareVectorInputPort("width_measured", 1)
        measured = {self._arm.ticket(), self._hand.ticket()}
        self.DeclareVectorOutputPort("positions", plant.num_positions(), self._calc, measured)

    def _calc(self, context: Context, output: BasicVector) -> None:
        robot = self._robot_default.copy()
        arm, width = self._arm.Eval(context), self._hand.Eval(context)
        if np.isfinite(arm).all():
            robot[:NUM_JOINTS] = arm
        if np.isfinite(width).all():
            robot[NUM_JOINTS:] = width[0] / (robot.size - NUM_JOINTS)
        positions = self._default.copy()
        self._plant.SetPositionsInArray(self._robot, robot, positions)
        output.SetFromVector(positions)
