"""The words of the contract: guarantees, features, terminations and limits."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["PROVING", "Feature", "Guarantee", "Limit", "Termination"]


class Guarantee(StrEnum):
    """What an answer of the backend proves, if its claims are right."""

    #: Its bound holds for every plan, and infeasible means that there is none.
    EXACT = "exact"
    #: No better plan nearby; nothing about plans further away.
    LOCAL = "local"
    #: A plan, if one was found.
    HEURISTIC = "heuristic"
    #: Its bound holds for every plan, and infeasible means that there is none; its point need not be
    #: a plan.
    RELAXATION = "relaxation"


#: Guarantees whose lower bounds and claims of infeasibility hold for the model.
PROVING = (Guarantee.EXACT, Guarantee.RELAXATION)


class Feature(StrEnum):
    """What a backend understands of the common request."""

    #: Stops at the relative gap asked for.
    GAP = "gap"
    #: Draws, and draws the same for the same seed.
    SEED = "seed"
    #: Uses as many threads as are asked for.
    THREADS = "threads"
    #: Starts its search from a plan.
    WARM_START = "warm start"
    #: Leaves out what is worse than a known objective.
    CUTOFF = "cutoff"
    #: Reports better plans while it runs.
    INCUMBENTS = "incumbents"
    #: Counts evaluations of the objective, and stops at the number granted.
    EVALUATIONS = "evaluations"
    #: Reports a lower bound.
    DUAL_BOUND = "dual bound"
    #: Reports row multipliers, from which the program computes its bound itself.
    DUALS = "duals"
    #: Stops soon when it is asked to.
    INTERRUPT = "interrupt"
    #: Prints a log of its own where ``verbose`` asks for it.
    LOG = "log"


class Termination(StrEnum):
    """How a run ended, apart from the limit that may have ended it."""

    #: A verified plan, proven optimal within the gap.
    OPTIMAL = "optimal"
    #: A verified plan that meets the conditions of a local optimum.
    LOCALLY_OPTIMAL = "locally_optimal"
    #: A verified plan, of which nothing more is known.
    FEASIBLE = "feasible"
    #: Proven: there is no plan.
    INFEASIBLE = "infeasible"
    #: No plan near the search; there may be one elsewhere.
    LOCALLY_INFEASIBLE = "locally_infeasible"
    #: Proven: plans are as good as one likes.
    UNBOUNDED = "unbounded"
    #: The run ended without a plan and without a proof.
    NO_SOLUTION = "no_solution"
    #: A plan was claimed and failed verification; the dispatcher's word, never a backend's.
    REJECTED = "rejected"
    #: The backend failed.
    FAILED = "failed"


class Limit(StrEnum):
    """The limit that ended a run."""

    #: The seconds were used up.
    TIME = "time"
    #: The memory that it may take was used up.
    MEMORY = "memory"
    #: The solver's own count of iterations, nodes or labels was used up.
    ITERATIONS = "iterations"
    #: The evaluations of the objective that were granted were used up.
    EVALUATIONS = "evaluations"
    #: A plan as good as the target was met.
    TARGET = "target"
    #: No better plan came for as long as was granted.
    STALLED = "stalled"
    #: Ctrl-C, or the caller.
    INTERRUPTED = "interrupted"
