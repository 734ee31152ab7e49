"""Rigid transforms and fits, sampling, unprojection, point clouds and clearances; no pydrake."""
