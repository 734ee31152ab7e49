"""Reads the true points of the functional part from the simulator."""

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import BasicVector, Context, LeafSystem


class PointObserver(LeafSystem):
    """Outputs the true points and the true pose of the object.

    .. pydrake_system::

        name: PointObserver
        input_ports:
        - body_poses
        output_ports:
        - points
        - confidence
        - object_pose

    Outputs follow the plant's `body_poses` without delay: `points` (3N,) row-major [m, world],
    `confidence` (N,), all ones, and `object_pose` (16,), the row-major X_WO of the driven body.

    Args:
        plant: The finalized plant.
        body: The driven body.
        carriers: For each of the N points, the body that carries it.
        p_BP: (N, 3) the points, each in the frame of its carrier [m].
    """

    def __init__(
        self, *, plant: MultibodyPlant, body: RigidBody, carriers: list[RigidBody], p_BP: np.ndarray
    ):
        super().__init__()
        self._body = body.index()
        self._points = [(body.index(), p) for body, p in zip(carriers, p_BP, strict=True)]
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
        output.SetFromVector(np.concatenate([poses[body] @ p for body, p in self._points]))

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._poses.Eval(context)[self._body].GetAsMatrix4().ravel())
