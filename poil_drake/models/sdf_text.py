"""Fragments of SDFormat that the generated models share."""

import numpy as np


def numbers(*values: float) -> str:
    """Returns numbers with six digits, separated by spaces; magnitudes up to 1e-14 become 0."""
    return " ".join(f"{value if abs(value) > 1e-14 else 0.0:.6g}" for value in values)


def inertial(mass: float, center: np.ndarray, inertia: np.ndarray) -> str:
    """Returns the <inertial> element of a link.

    Args:
        mass: The mass [kg].
        center: (3,) centre of mass in the link's frame [m].
        inertia: (3, 3) rotational inertia about the centre of mass [kg m^2].
    """
    ixx, iyy, izz = (numbers(value) for value in np.diag(inertia))
    ixy, ixz, iyz = (numbers(value) for value in inertia[np.triu_indices(3, 1)])
    return f"""
      <inertial>
        <pose>{numbers(*center)} 0 0 0</pose>
        <mass>{numbers(mass)}</mass>
        <inertia>
          <ixx>{ixx}</ixx><iyy>{iyy}</iyy><izz>{izz}</izz>
          <ixy>{ixy}</ixy><ixz>{ixz}</ixz><iyz>{iyz}</iyz>
        </inertia>
      </inertial>"""
