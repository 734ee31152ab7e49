"""Grasp candidates, feasibility of their rollouts, approach paths. No pydrake."""
