"""100 random maps in three dimensions: verified flights, flight times and computing times of both backends.

The plans are verified by the model, and again by rational arithmetic on Bézier points and cells.

::

    python tests/benchmarks/flight/maps.py [MAPS]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "tests")]

from benchmarks.measured import write  # noqa: E402
from flight.flights import is_clear  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack import jit  # noqa: E402
from crosstrack.instances.flight import forest, noise_map  # noqa: E402
from crosstrack.models import Flight, Quadrotor  # noqa: E402

#: GCOPTER's example: mass, thrust, tilt, body rate and speed of its vehicle, and a radius.
VEHICLE = Quadrotor(0.61, (2.0, 12.0), tilt=1.05, body_rate=2.1, speed=4.0)
#: Fewest maps of a table.
FEWEST = 20
RADIUS, SIZE = 0.2, (25.0, 25.0, 5.0)
ENDS = np.array([[1.5, 1.5, 2.5], [23.5, 23.5, 2.5]])


def flight(seed: int) -> Flight | None:
    """Return the flight of a seed, alternately through a forest and through noise."""
    if seed % 2:
        world = noise_map(seed, SIZE, keep=ENDS)
    else:
        world = forest(seed, SIZE, pillars=40, rings=10, keep=ENDS)
    return Flight(world, ENDS[0], ENDS[1], VEHICLE, radius=RADIUS)


def main() -> None:
    """Fly over all maps, and write the table."""
    maps = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    jit.compile_always()
    ct.solve(flight(-1 % 1000))
    ct.solve(flight(998), "staged")
    rows: dict[str, list[tuple[float, ...]]] = {"minco": [], "staged": []}
    closed = []
    seed = count = 0
    while count < maps:
        model = flight(seed)
        entry = {}
        for backend in rows:
            begin = time.process_time()
            solution = ct.solve(model, backend)
            spent = time.process_time() - begin
            exact = solution.plan is not None and is_clear(
                solution.plan.trajectory, model.map, RADIUS - 1e-6 * model.cell
            )
            entry[backend] = solution, spent, exact
        if all(solution.termination == "infeasible" for solution, _, _ in entry.values()):
            closed.append(seed)  # proven: the map has no way
        else:
            count += 1
            for backend, (solution, spent, exact) in entry.items():
                verified = solution.plan is not None and solution.verification.ok
                duration = solution.plan.duration if solution.plan is not None else np.nan
                rows[backend].append(
                    (verified, exact, duration, duration / solution.dual_bound, spent)
                )
                if not (verified and exact):
                    print("seed", seed, backend, solution.termination, solution.message, exact)
        seed += 1
        if seed % 10 == 0:
            print(seed, flush=True)
            tabulate(rows, closed, seed)
    tabulate(rows, closed, seed)


def tabulate(rows: dict[str, list[tuple[float, ...]]], closed: list[int], seed: int) -> None:
    """Write the table of the maps up to a seed."""
    table = []
    for backend, values in rows.items():
        data = np.array(values, float)
        table.append(
            (
                backend,
                f"{int(data[:, 0].sum())} of {len(data)}",
                f"{int(data[:, 1].sum())} of {len(data)}",
                float(np.nanmedian(data[:, 2])),
                float(np.nanmedian(data[:, 3])),
                float(np.median(data[:, 4])),
                float(data[:, 4].max()),
            )
        )
        print(*table[-1], flush=True)
    names = f" (seeds {', '.join(map(str, closed))})" if closed else ""
    said = (
        f"Maps of 25 m × 25 m × 5 m in cubes of 0.25 m, half forests and half noise, seeds 0 to {seed - 1}; "
        f"{len(closed)} maps without a way, proven, are left out{names}. The bound is the time along the straight "
        "line within the limits. CPU includes path, corridor, curve and verification."
    )
    columns = {
        "backend": "", "verified": "", "clear by exact arithmetic": "", "flight time (s)": ".2f",
        "over the bound": ".3f", "CPU (s)": ".2f", "CPU, greatest (s)": ".2f",
    }  # fmt: skip
    if len(rows["minco"]) >= FEWEST:
        write("flight", "maps", __file__, columns, table, ("numpy", "scipy", "numba"), said)


if __name__ == "__main__":
    main()
