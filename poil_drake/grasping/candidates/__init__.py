"""Grasp candidates and how they are sampled."""
