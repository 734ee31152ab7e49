"""Converts numbers and forces to the form in which a run log holds them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

from poil_drake.systems.statuses import RobotMode

ROBOT_MODES = {int(mode): mode.name.lower() for mode in RobotMode}
"""Number of each robot mode -> its name."""


def meaning(texts: Mapping[int, str], number: float) -> str:
    """Returns the text of a number; its digits if it has no text, "unknown" if it is not finite."""
    return texts.get(int(number), str(int(number))) if np.isfinite(number) else "unknown"


def applied_forces(
    forces: Sequence[ExternallyAppliedSpatialForce], body_names: Sequence[str]
) -> list[dict[str, Any]]:
    """Returns the `body`, `force` [N, world] and `torque` [N m, world] of each non-zero force.

    Args:
        forces: The plant's externally applied forces.
        body_names: The names of the plant's bodies, by body index.
    """
    names = dict(enumerate(body_names))
    return [
        {
            "body": meaning(names, int(force.body_index)),
            "force": force.F_Bq_W.translational(),
            "torque": force.F_Bq_W.rotational(),
        }
        for force in forces
        if np.any(force.F_Bq_W.get_coeffs())
    ]
