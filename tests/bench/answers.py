"""Answers made by hand, and the page of them."""

from types import SimpleNamespace

from crosstrack.models.verification import Check, Verification
from crosstrack.solvers.bench import write_page
from crosstrack.solvers.contract.enums import Guarantee, Limit, Termination
from crosstrack.solvers.contract.solution import Incumbent, Solution

EVIL = "<script>window.hit=1</script>\"'><img src=x onerror=window.hit=1>&amp;"
GOOD = Verification(
    objective=1.0, checks=(Check("length", "(1)", 2e-7, "m", 1e-6, "edge 3", rounding=1e-9),)
)  # fmt: skip


def answer(instance, backend, objective, seconds, *, kind="grid-path", **more):
    """An answer whose plan was verified; no plan where `objective` is None."""
    given = {
        "model": kind, "instance": instance, "digest": instance.encode().hex(), "backend": backend,
        "termination": Termination.NO_SOLUTION if objective is None else Termination.FEASIBLE,
        "guarantee": Guarantee.HEURISTIC, "primal_bound": objective, "version": "0.1.0",
        "stored_plan": None if objective is None else [0, 1], "backend_version": "1.2",
        "seconds": {"solve": seconds, "build": seconds / 10, "total": 2 * seconds},
        "options": {"time_limit": 10.0, "gap": 1e-6, "tolerance": 1e-6},
    }  # fmt: skip
    return Solution(**{**given, **more})


def exact(instance, backend, objective, seconds, **more):
    return answer(
        instance, backend, objective, seconds, guarantee=Guarantee.EXACT,
        **{
            "dual_bound": objective, "termination": Termination.OPTIMAL,
            "verification": Verification(objective=objective, checks=()), **more,
        },
    )  # fmt: skip


def campaign():
    """Three problems: one with agreement, one with a contradiction, one that is open."""
    steps = tuple(Incumbent(10.0**-i, 5.0 + i) for i in range(3, 0, -1))
    clean = Verification(objective=9.0, checks=())
    return [
        exact("grid-path/one", "a-star", 10.0, 0.5),
        answer("grid-path/one", "greedy", 12.0, 0.01),
        exact("grid-path/two", "a-star", 9.5, 2.0, message="slow"),
        answer("grid-path/two", "greedy", 9.5, 0.02, incumbents=steps),
        answer("grid-path/two", "broken", None, 0.1, termination=Termination.FAILED, message=EVIL),
        exact("fleet/wrong", "prover", 11.0, 1.0, kind="fleet", formulation="arcs", seed=3),
        answer("fleet/wrong", "finder", 9.0, 3.0, kind="fleet", verification=clean),
        answer("fleet/wrong", "near", 9.5, 3.0, kind="fleet", verification=GOOD),
        *(
            answer(EVIL, f"swarm-{i}", 1.0 + i, 0.1 * (i + 1), kind="black-box", seed=s, limit=Limit.EVALUATIONS)
            for i in range(9)
            for s in range(2)
        ),
    ]  # fmt: skip


def write(folder, solutions, **more):
    return write_page(SimpleNamespace(solutions=tuple(solutions)), folder / "page.html", **more)
