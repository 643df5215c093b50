"""Benchmark results of messenger tours, as the tables of ``docs/problems/messenger.md``.

``python tests/benchmarks/messenger/tables.py TABLE [VEHICLES]`` makes one of ``gaps``, ``few``, ``spread``
and ``public``, or some of its rows, and writes ``docs/measured/messenger.json``. The tables of the paper are
measured by ``tests/benchmarks/papers.py``. Limits and times count CPU seconds.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks import cpu_clock  # noqa: E402, F401 - before crosstrack
from benchmarks.measured import write  # noqa: E402
from benchmarks.messenger import test_tour_search as search  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.messenger import generate, read_best_known, read_dtspn  # noqa: E402

Rows = Iterator[tuple[Any, ...]]
#: Seconds of a search for each vehicle or disc, in the tables of the public instances and the spread.
EACH = 0.2


def gaps(vehicles: int) -> Rows:
    """The gap to the proven bound, all defaults."""
    found = [
        search.run(generate(vehicles, float(kappa), 1000 * vehicles + row), "tour-search", 0, None)
        for row, kappa in enumerate(np.linspace(2.5, 17.0, 10), 1)
    ]
    apart = [one.gap for one in found]
    seconds = float(np.median([one.seconds["solve"] for one in found]))
    yield (vehicles, seconds, float(np.median(apart)), float(max(apart)))


def few(vehicles: int) -> Rows:
    """The gap of few vehicles with short legs, if a gap of 1 % is requested."""
    found = [
        ct.solve(generate(vehicles, float(kappa), 3000 * vehicles + row), seed=0, gap=0.01)
        for row, kappa in enumerate(np.linspace(0.0, 4.0, 10), 1)
    ]
    apart = [one.gap for one in found]
    seconds = float(np.median([one.seconds["solve"] for one in found]))
    optimal = int(sum(gap <= 0.01 for gap in apart))
    yield (vehicles, len(found), seconds, float(np.median(apart)), float(max(apart)), optimal)


def spread(vehicles: int) -> Rows:
    """How far apart five seeds end."""
    seconds, apart = EACH * vehicles, []
    for kappa in (2.5, 6.0, 10.0, 17.0):
        model = generate(vehicles, kappa, 2000 * vehicles + len(apart) + 1)
        lengths = np.array(
            [
                search.run(model, "tour-search", seed, seconds, **search.ENDLESS).primal_bound
                for seed in range(5)
            ]
        )
        apart.append(float(lengths.std() / lengths.mean()))
    yield (vehicles, seconds, *apart)


def public(discs: int) -> Rows:
    """Public static closed tours beside the published upper bounds, every third instance."""
    known = read_best_known(search.DATA / "best_known.csv")
    names = sorted(name for name in known if name.startswith(f"dtspn-{discs:02}-"))[::3]
    above, own = [], []
    for name in names:
        model = read_dtspn(search.DATA / f"{name.removesuffix('.txt')}.txt")
        found = search.run(model, "tour-search", 0, EACH * discs, patience=10**6)
        above.append(found.primal_bound / known[name][1] - 1)
        own.append(found.gap)
    shorter = sum(one < -1e-7 for one in above)
    ends = (float(np.median(above)), max(above), min(above))
    yield (discs, len(names), EACH * discs, *ends, shorter, float(np.median(own)))


_VEHICLES = {"vehicles": "", "seconds": ".2f"}
#: What each table is made of: rows, heads with formats.
TABLES: dict[str, tuple[Callable[[int], Rows], tuple[int, ...], dict[str, str]]] = {
    "gaps": (gaps, (5, 10, 20), {**_VEHICLES, "median gap": ".2%", "worst": ".2%"}),
    "few": (
        few, (2, 3),
        {
            "vehicles": "", "instances": "", "seconds": ".2f", "median gap": ".2%", "worst": ".2%",
            "within 1 %": "",
        },
    ),
    "spread": (
        spread, (30, 40),
        {**_VEHICLES, "sparsity 2.5": ".1%", "6": ".1%", "10": ".1%", "17": ".1%"},
    ),
    "public": (
        public, (6, 8, 10, 12, 14, 16, 18, 20, 25, 30),
        {
            "discs": "", "instances": "", "seconds": ".1f", "median difference": "+.0e", "largest": "+.0e",
            "least": "+.0e", "shorter on": "", "median gap to our bound": ".0e",
        },
    ),
}  # fmt: skip


def main(name: str, *some: str) -> None:
    """Make a table, or some of its rows."""
    make, every, columns = TABLES[name]
    model = generate(3, 5.0, 1)
    ct.solve(model, "tour-search", time_limit=1)  # compile
    for size in map(int, some or map(str, every)):
        rows = list(make(size))
        print(name, *rows, flush=True)
        write("messenger", name, __file__, columns, rows, ("numba",), merge=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
