"""RRT-Connect (Kuffner and LaValle 2000) by OMPL, with batched checks of edges."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from ompl import base, geometric, util

from poil_drake.planning.path_shortening import IsFree

State = Any  # An OMPL state; the bindings have no types.


@dataclass(frozen=True, eq=False)
class VectorSpace:
    """Vectors in a box, such as joint positions, and their conversion to and from OMPL states.

    Attributes:
        lower: (D,) lowest values.
        upper: (D,) highest values.
    """

    lower: np.ndarray
    upper: np.ndarray

    def make(self) -> Any:
        """Returns the OMPL state space."""
        space = base.RealVectorStateSpace(len(self.lower))
        space.setBounds(make_bounds(self.lower, self.upper))
        return space

    def read(self, state: State) -> np.ndarray:
        """Returns the vector (D,) of a state."""
        return np.array([state[k] for k in range(len(self.lower))])

    def write(self, state: State, values: np.ndarray) -> None:
        """Sets a state to a vector (D,)."""
        for k, value in enumerate(values.tolist()):
            state[k] = value


def make_bounds(lower: np.ndarray, upper: np.ndarray) -> Any:
    """Returns the OMPL bounds of the box between two corners (D,)."""
    bounds = base.RealVectorBounds(len(lower))
    for k, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
        bounds.setLow(k, low)
        bounds.setHigh(k, high)
    return bounds


def rrt_connect(
    space: VectorSpace,
    start: np.ndarray,
    goal: np.ndarray,
    *,
    is_free: IsFree,
    edge_is_free: Callable[[np.ndarray, np.ndarray], bool],
    max_edge: float,
    iterations: int,
    seed: int,
) -> np.ndarray | None:
    """Returns the corners (K, D) of a free path from start to goal; None if no path is found.

    The outcome depends only on the arguments, not on the machine's speed.

    Args:
        space: The space to search.
        start: (D,) start of the path.
        goal: (D,) end of the path.
        is_free: Returns which configurations (B, D) are free: (B,) bool.
        edge_is_free: Returns whether the straight edge between two configurations (D,) is free.
        max_edge: Longest edge of the search trees, in the space's metric.
        iterations: Largest number of rounds of tree growth.
        seed: Seed of the samples.
    """
    util.noOutputHandler()
    # Generators created from now on draw their seeds from this one; 0 is not a valid seed.
    util.RNG.setSeed(seed + 1)

    class BatchMotionValidator(base.MotionValidator):
        """Checks the configurations of an edge in one batch, which is fast enough in Python."""

        def checkMotion(self, first: State, last: State, *last_valid: Any) -> bool:
            return edge_is_free(space.read(first), space.read(last))

    information = base.SpaceInformation(space.make())
    information.setStateValidityChecker(lambda state: bool(is_free(space.read(state)[None])[0]))
    information.setMotionValidator(BatchMotionValidator(information))
    information.setup()

    def state_of(values: np.ndarray) -> State:
        state = information.allocState()
        space.write(state, values)
        return state

    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(state_of(start), state_of(goal))
    planner = geometric.RRTConnect(information)
    planner.setProblemDefinition(problem)
    planner.setRange(max_edge)
    planner.setup()
    rounds = iter(range(iterations))
    planner.solve(base.PlannerTerminationCondition(lambda: next(rounds, None) is None))
    if not problem.hasExactSolution():
        return None
    return np.array([space.read(state) for state in problem.getSolutionPath().getStates()])
