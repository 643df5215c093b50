"""Enumerations of the contract: guarantees, features, terminations and limits."""

from __future__ import annotations

from enum import StrEnum

__all__ = [
    "CLAIMS_NONE",
    "CLAIMS_PLAN",
    "PROVING",
    "Feature",
    "Guarantee",
    "Limit",
    "Termination",
]


class Guarantee(StrEnum):
    """Strength of the claims of a backend, provided that its implementation is correct."""

    #: Bounds are valid for every plan, and "infeasible" is a proof.
    EXACT = "exact"
    #: The plan is a local optimum. Plans further away may be better.
    LOCAL = "local"
    #: The plan is feasible, without any statement about its quality.
    HEURISTIC = "heuristic"
    #: Bounds are valid for every plan, and "infeasible" is a proof. The point need not be a plan.
    RELAXATION = "relaxation"


#: Guarantees whose lower bounds and claims of infeasibility are proofs.
PROVING = (Guarantee.EXACT, Guarantee.RELAXATION)


class Feature(StrEnum):
    """Option of the common request, or report, that a backend supports."""

    #: Stops at the requested relative gap.
    GAP = "gap"
    #: Uses random numbers, and repeats its run for the same seed.
    SEED = "seed"
    #: Uses the requested number of threads.
    THREADS = "threads"
    #: Starts its search from a plan.
    WARM_START = "warm start"
    #: Discards plans that are worse than a known objective.
    CUTOFF = "cutoff"
    #: Reports improved plans during the run.
    INCUMBENTS = "incumbents"
    #: Counts evaluations of the objective and stops at their limit.
    EVALUATIONS = "evaluations"
    #: Reports a lower bound.
    DUAL_BOUND = "dual bound"
    #: Reports row multipliers, from which the program computes a bound.
    DUALS = "duals"
    #: Stops soon after a stop request.
    INTERRUPT = "interrupt"
    #: Prints its own log if ``verbose`` is true.
    LOG = "log"


class Termination(StrEnum):
    """Status of a solution; the limit that ended the run, if any, is separate."""

    #: The plan is verified and proven optimal within the gap.
    OPTIMAL = "optimal"
    #: The plan is verified and satisfies the conditions of a local optimum; a better one may exist.
    LOCALLY_OPTIMAL = "locally_optimal"
    #: The plan is verified; its distance from the optimum is unknown or above the gap.
    FEASIBLE = "feasible"
    #: It is proven that no plan exists.
    INFEASIBLE = "infeasible"
    #: The search found no plan nearby. One may exist elsewhere: try another start.
    LOCALLY_INFEASIBLE = "locally_infeasible"
    #: It is proven that the objective of plans is unbounded below.
    UNBOUNDED = "unbounded"
    #: The run ended without a plan and without a proof.
    NO_SOLUTION = "no_solution"
    #: The claimed plan failed verification and is not returned. Assigned by the dispatcher only.
    REJECTED = "rejected"
    #: The backend raised an error or crashed; the message gives the reason.
    FAILED = "failed"


#: Terminations that claim a plan.
CLAIMS_PLAN = (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL, Termination.FEASIBLE)
#: Terminations that claim that no optimal plan exists.
CLAIMS_NONE = (Termination.INFEASIBLE, Termination.UNBOUNDED)


class Limit(StrEnum):
    """Limit that ended a run; the solution holds the incumbent, if any."""

    #: The time limit was reached.
    TIME = "time"
    #: The memory limit was reached.
    MEMORY = "memory"
    #: The solver's limit on iterations, nodes or labels was reached.
    ITERATIONS = "iterations"
    #: The limit on evaluations of the objective was reached.
    EVALUATIONS = "evaluations"
    #: The target objective was reached.
    TARGET = "target"
    #: No better plan was found for the given number of seconds.
    STALLED = "stalled"
    #: The user (Ctrl-C) or the calling code stopped the run.
    INTERRUPTED = "interrupted"
