"""Rigid fits, sampling, unprojection and point clouds. No pydrake."""
