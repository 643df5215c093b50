"""The turns of the catalogue and greater ones by default, and flights along a plan, for the slew's page.

``python tests/benchmarks/satellite_slew/flown.py`` writes ``docs/measured/satellite-slew.json``;
``values``, ``turns`` or ``flown`` makes those tables alone.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances import entries  # noqa: E402
from crosstrack.models import SatelliteSlew, track  # noqa: E402
from crosstrack.models.satellite_slew.flight import Breach  # noqa: E402

#: Signs of the torque about the three axes.
AXES = np.array([1.0, -1.0, -1.0])
#: Flights: description, relative error of the inertia, disturbance torque (N m), known share of it.
FLIGHTS = (
    ("as planned", 0.0, 0.0, 0.0),
    *((f"inertia {100 * share:+g} %", share, 0.0, 0.0) for share in (0.02, -0.02, 0.05, -0.05)),
    *(
        (f"{torque:g} N m, {'known' if known else 'not known'}", 0.0, torque, known)
        for torque in (0.1, -0.1, 1.0, -1.0)
        for known in (0.0, 1.0)
    ),
)
#: The flights that are flown along the plan that keeps farther away as well.
WARY = ("inertia +2 %", "inertia -2 %", "inertia +5 %", "0.1 N m, not known", "-0.1 N m, not known")


def breach_words(breach: Breach | None) -> str:
    """Return which limit breaks first and when; at the end, by how much."""
    if breach is None:
        return "none"
    if breach.name.startswith("final"):
        return f"{breach.name}, {breach.worst:.1e}"
    return f"{breach.name}, {breach.time:.2f} s"


def values() -> None:
    """Solve the catalogue's instances with defaults, but for the one that has no plan."""
    rows = []
    for entry in entries():
        if entry.name.startswith("satellite-slew/") and not entry.name.endswith("/infeasible"):
            begin = time.perf_counter()
            found = ct.solve(ct.load(entry.name))
            seconds = time.perf_counter() - begin
            end = found.plan.phases[0].end if found.plan is not None else None
            rows.append((entry.name, found.primal_bound, end, seconds))
            print(*rows[-1], found.termination, flush=True)
    columns = {"instance": "", "J": ".4f", "final time": ".4f", "seconds": ".0f"}
    write("satellite-slew", "values", __file__, columns, rows, ("casadi",))


def turns() -> None:
    """Solve nine turns with defaults."""
    rows: list[tuple[Any, ...]] = []
    for axis in ("roll", "pitch", "yaw"):
        for angle in (90.0, 120.0, 180.0):
            begin = time.perf_counter()
            found = ct.solve(SatelliteSlew.about(axis, angle))
            seconds = time.perf_counter() - begin
            assert found.plan is not None, found.message
            assert found.verification is not None
            # The largest share of its tolerance; tolerances have the scale of what they bound.
            worst = max(found.verification.checks, key=lambda one: one.worst / one.tolerance)
            share = 1e-6 * worst.worst / worst.tolerance
            values = (found.primal_bound, found.plan.phases[0].end)
            rows.append((f"{axis} {angle:g}°", *values, share, worst.name, seconds))
            print(rows[-1], flush=True)
    columns = {
        "turn": "", "J, s": ".4f", "tf, s": ".3f", "worst check": ".1e", "of": "", "seconds": ".0f",
    }  # fmt: skip
    write("satellite-slew", "turns", __file__, columns, rows, ("casadi",))


def flown() -> None:
    """Fly along the plan with a tenth in reserve, and along one that keeps farther away."""
    model = SatelliteSlew(margin=0.1)
    columns = {
        "flown": "", "quaternion error": ".1e", "rate error, rad/s": ".1e", "saturated": ".1%",
        "least measure": ".3g", "first breach": "",
    }  # fmt: skip
    for name, limit, flights in (
        ("flown", model.singularity_limit, [one[0] for one in FLIGHTS]),
        ("wary", 0.4, WARY),
    ):
        planned = SatelliteSlew(margin=0.1, singularity_limit=limit)
        found = ct.solve(planned, formulation="gauss", tolerance=1e-4)
        rows = []
        for words, share, torque, known in FLIGHTS:
            if words not in flights:
                continue
            flight = track(
                model,
                found,
                disturbance=torque * AXES,
                known_disturbance=known,
                inertia_error=share,
            )
            errors = (flight.max_quaternion_error, flight.max_rate_error)
            least = (float(flight.saturated.mean()), float(flight.measures.min()))
            rows.append((words, *errors, *least, breach_words(flight.breach)))
            print(rows[-1], flush=True)
        assert found.plan is not None, found.message
        said = f"The plan: J = {found.primal_bound:.3f} s, tf = {found.plan.phases[0].end:.3f} s."
        write("satellite-slew", name, __file__, columns, rows, ("casadi",), said)


if __name__ == "__main__":
    for make in (values, flown, turns):
        if make.__name__ in (sys.argv[1:] or (make.__name__,)):
            make()
