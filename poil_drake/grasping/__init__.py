"""Grasp candidates, their rehearsal, the motions to a grasp, and the plan. No pydrake."""
