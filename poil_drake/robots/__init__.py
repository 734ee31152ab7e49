"""The Panda: its data, kinematics, shape, limits and inverse kinematics, without Drake."""
