"""Rehearsal of grasp candidates, and the selection among them."""
