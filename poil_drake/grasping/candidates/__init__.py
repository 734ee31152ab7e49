"""Grasp candidates and their sampling."""
