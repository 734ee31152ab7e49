"""The Panda as data and maths: kinematics, limits, shape, posture and IK. No pydrake."""
