"""Constants of the Franka Panda: names, dimensions and limits. 7-vectors are in joint order."""

import numpy as np

from poil_drake.geometry.frozen_array import frozen_array

NUM_JOINTS = 7
"""Number of joints of the arm."""

ARM_LINKS = tuple(f"panda_link{i}" for i in range(NUM_JOINTS + 1))
"""Links of the arm, from the base to the last one that a joint moves."""

BASE_LINK = ARM_LINKS[0]
"""The link that is welded to the world."""

ARM_JOINTS = tuple(f"panda_joint{i + 1}" for i in range(NUM_JOINTS))
"""Joints of the arm, in the order of every 7-vector."""

FINGER_JOINTS = ("panda_finger_joint1", "panda_finger_joint2")
"""Joints of the fingers; the second one mimics the first."""

GRIPPER_FRAME = "panda_hand_tcp"
"""The gripper frame G, between the finger tips: approach along +z, fingers close along y."""

NOMINAL_POSTURE = frozen_array(
    [0.0, -np.pi / 4, 0.0, -3.0 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4],
    name="NOMINAL_POSTURE",
    shape=(NUM_JOINTS,),
)
"""The usual ready posture (7,) [rad]: elbow up, gripper pointing down, far from every limit."""

ACCELERATION_LIMITS = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
"""Largest joint accelerations [rad/s^2], from the datasheet; the URDF has none."""

JERK_LIMITS = (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0)
"""Largest joint jerks [rad/s^3], from Franka's documentation."""

MAX_HAND_WIDTH = 0.08
"""Largest opening between the finger pads [m]."""
