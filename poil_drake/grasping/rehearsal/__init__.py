"""Rollouts of grasp candidates, and the choice among them."""
