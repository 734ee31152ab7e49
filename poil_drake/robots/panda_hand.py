"""The shape of the Franka hand, as boxes in the gripper frame."""

from dataclasses import dataclass

import numpy as np

from poil_drake.robots.panda import MAX_HAND_WIDTH


@dataclass(frozen=True, kw_only=True)
class GripperGeometry:
    """The Franka hand in the gripper frame G.

    +z is the approach direction, and the fingers close along y. Lengths are in metres, measured on
    the collision meshes of the Panda's description: each finger is a slim tip that carries the pad
    and a thicker base that is screwed to the hand.

    Attributes:
        max_width: Largest opening between the pads.
        finger_width: Finger extent along x.
        tip_thickness: Finger extent along y over the tip.
        tip_end: z of the finger's end; it lies beyond the frame's origin.
        tip_length: Length of the tip along z.
        base_thickness: Finger extent along y between the tip and the hand.
        hand_size: (x, y, z) extents of the hand's body.
        hand_bottom: z of the hand's face that carries the fingers.
    """

    max_width: float = MAX_HAND_WIDTH
    finger_width: float = 0.021
    tip_thickness: float = 0.0175
    tip_end: float = 0.0088
    tip_length: float = 0.02
    base_thickness: float = 0.0265
    hand_size: tuple[float, float, float] = (0.0635, 0.206, 0.092)
    hand_bottom: float = -0.0374

    def finger_boxes(self, width: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns the lower and upper corners, (4, 3) [m] each, of the boxes of the fingers.

        The order is: tip and base of the finger at +y, tip and base of the finger at -y.

        Args:
            width: Distance between the pads [m].
        """
        half, inner = 0.5 * self.finger_width, 0.5 * width
        tip_start = self.tip_end - self.tip_length
        lower = np.array([(-half, inner, tip_start), (-half, inner, self.hand_bottom)])
        upper = np.array(
            [
                (half, inner + self.tip_thickness, self.tip_end),
                (half, inner + self.base_thickness, tip_start),
            ]
        )
        far_lower, far_upper = lower.copy(), upper.copy()
        far_lower[:, 1], far_upper[:, 1] = -upper[:, 1], -lower[:, 1]
        return np.concatenate([lower, far_lower]), np.concatenate([upper, far_upper])

    def hand_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the lower and the upper corner, (3,) [m] each, of the hand's body."""
        x, y, z = self.hand_size
        lower = np.array([-0.5 * x, -0.5 * y, self.hand_bottom - z])
        return lower, np.array([0.5 * x, 0.5 * y, self.hand_bottom])
