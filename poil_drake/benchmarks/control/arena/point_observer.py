"""Reads the true points of the functional part from the simulator."""

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import BasicVector, Context, LeafSystem


class PointObserver(LeafSystem):
    """The ground truth that every policy of the study observes.

    .. pydrake_system::

        name: PointObserver
        input_ports:
        - body_poses
        output_ports:
        - points
        - confidence
        - object_pose

    All outputs follow the plant's `body_poses` directly: `points` (3N,) row-major [m, world],
    `confidence` (N,) all one, `object_pose` (16,) X_WO row-major of the driven body.

    Args:
        plant: The finalized plant.
        body: The driven body.
        carriers: N bodies, one per point: the body that carries it.
        p_BP: (N, 3) the points in these bodies' frames [m].
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        body: RigidBody,
        carriers: list[RigidBody],
        p_BP: np.ndarray,
    ):
        super().__init__()
        self._body = body.index()
        indices = np.array([int(carrier.index()) for carrier in carriers])
        self._groups = [(BodyIndex(k), np.flatnonzero(indices == k)) for k in np.unique(indices)]
        self._p_BP = p_BP
        poses = [RigidTransform()] * plant.num_bodies()
        self._poses = self.DeclareAbstractInputPort("body_poses", Value(poses))
        ticket = {self._poses.ticket()}
        n = len(p_BP)
        self.DeclareVectorOutputPort("points", 3 * n, self._calc_points, ticket)
        self.DeclareVectorOutputPort(
            "confidence",
            n,
            lambda context, output: output.SetFromVector(np.ones(n)),
            {self.nothing_ticket()},
        )
        self.DeclareVectorOutputPort("object_pose", 16, self._calc_pose, ticket)

    def _calc_points(self, context: Context, output: BasicVector) -> None:
        poses = self._poses.Eval(context)
        points = np.empty_like(self._p_BP)
        for body, members in self._groups:
            points[members] = (poses[body] @ self._p_BP[members].T).T
        output.SetFromVector(points.ravel())

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._poses.Eval(context)[self._body].GetAsMatrix4().ravel())
