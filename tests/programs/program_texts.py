"""Texts of small programs in MPS, LP and NL format, with every feature that the package reads."""

from __future__ import annotations

import random

MPS = """NAME sample
OBJSENSE
    MAX
ROWS
 N cost
 L limit
 G demand
 E balance
 E span
 N other
COLUMNS
 x cost 1 limit 2.5
 x demand 1 span -1e-3
 MARK 'MARKER' 'INTORG'
 y cost -2 balance 1
 z limit 1 other 4
 count balance -3.25
 MARK 'MARKER' 'INTEND'
 w demand 7 span 2
 v balance .5 limit 1E2
RHS
 rhs cost 12 limit 4
 rhs demand -2 balance 3
RANGES
 range limit 2.5 demand 3
 range span -4
BOUNDS
 UP bound y 5
 MI bound w
 UP bound w -1
 FX bound v 2.5
 LO bound count 2
ENDATA
"""

QUADRATIC_MPS = MPS.replace("MAX", "MIN").replace(
    "ENDATA", "QUADOBJ\n x x 4\n x w 1\n w w 3\n v v 0.5\nENDATA"
)

LP = r"""\ A sample
Maximize
 profit: 3 x - 2.5 y + z - 1e-3 w
  + 4 v - 12
Subject To
 first: x + y + 2 z <= 10
 second: - x + 3.5 w
  >= -2
 x + v = 3
 fourth: 0 y + w - v <= 1e2
Bounds
 -inf <= x <= 4.5
 y <= 8
 2 <= z <= 7
 w free
General
 z y
Binary
 v
End
"""

QUADRATIC_LP = """Minimize
 cost: x + 2 y + [ 4 x ^ 2 + 2 x * y + 3 y ^ 2 - x * z + 5 z ^ 2 ] / 2
Subject To
 c1: x + y - z >= 1
 c2: x - z <= 4
Bounds
 x >= -3
 z = 2.5
End
"""

NL = """g3 1 1 0\t# problem sample
 3 2 1 1 1\t# vars, constraints, objectives, ranges, eqns
 1 1\t# nonlinear constraints, objectives
 0 0\t# network constraints: nonlinear, linear
 2 1 1\t# nonlinear vars in constraints, objectives, both
 0 0 0 1\t# linear network variables; functions; arith, flags
 0 1 0 0 0\t# discrete variables: binary, integer, nonlinear (b,c,o)
 4 2\t# nonzeros in Jacobian, obj. gradient
 6 1\t# max name lengths: constraints, variables
 1 0 0 0 0\t# common exprs: b,c,o,c1,o1
V3 1 0
1 2.5
o5
v0
n2
C0
o54
3
v3
o44
v1
o2
n-1.5
v0
C1
n0
O0 1
o43
o0
n3.5
v3
x2
0 1.5
1 -2
r
0 -1 25
4 3
b
0 -1 5
2 0.25
0 0 10
k2
1
2
J0 2
0 0
1 1
J1 2
1 -1
2 2
G0 2
0 1
2 -3
"""
NL = NL.replace("k2\n1\n2\n", "k2\n1\n3\n")


def random_nl(seed: int) -> str:
    """Return a random program in NL format."""
    draw = random.Random(seed)
    nonlinear, linear, rows = draw.randint(1, 4), draw.randint(0, 3), draw.randint(0, 4)
    columns = nonlinear + linear

    def number() -> str:
        return repr(round(draw.uniform(-4, 4), 3))

    def expression(depth: int) -> list[str]:
        if not depth or draw.random() < 0.2:
            return [f"v{draw.randrange(nonlinear)}"] if draw.random() < 0.7 else [f"n{number()}"]
        kind = draw.random()
        if kind < 0.3:
            return [f"o{draw.choice((15, 16, 37, 41, 44, 46, 49))}", *expression(depth - 1)]
        if kind < 0.8:
            operator = draw.choice((0, 1, 2, 3, 5))
            right = ["n2"] if operator == 5 else expression(depth - 1)
            return [f"o{operator}", *expression(depth - 1), *right]
        parts = [expression(depth - 1) for _ in range(3)]
        return ["o54", "3", *(token for part in parts for token in part)]

    body: list[str] = []
    jacobian = [sorted(draw.sample(range(columns), draw.randint(1, columns))) for _ in range(rows)]
    for row in range(rows):
        body += [f"C{row}", *expression(3)]
    body += [f"O0 {draw.randint(0, 1)}", *expression(3)]
    body += [f"x{columns}", *(f"{column} {number()}" for column in range(columns))]
    kinds = {row: draw.choice("01234") for row in range(rows)}
    bounds = {"0": "0 -3 4.5", "1": "1 5", "2": "2 -2.25", "3": "3", "4": "4 1"}
    if rows:
        body += ["r", *(bounds[kind] for kind in kinds.values())]
    body += ["b", *(bounds[draw.choice("0123")] for _ in range(columns))]
    starts = [sum(column <= k for row in jacobian for column in row) for k in range(columns - 1)]
    body += [f"k{columns - 1}", *map(str, starts)]
    for row, places in enumerate(jacobian):
        body += [f"J{row} {len(places)}", *(f"{column} {number()}" for column in places)]
    gradient = sorted(draw.sample(range(columns), draw.randint(1, columns)))
    body += [f"G0 {len(gradient)}", *(f"{column} {number()}" for column in gradient)]
    counts = list(kinds.values())
    integers = draw.randint(0, linear)
    head = [
        "g3 1 1 0",
        f" {columns} {rows} 1 {counts.count('0')} {counts.count('4')}",
        f" {rows} 1",
        " 0 0",
        f" {nonlinear} {nonlinear} {nonlinear}",
        " 0 0 0 1",
        f" 0 {integers} {draw.randint(0, nonlinear)} 0 0",
        f" {sum(map(len, jacobian))} {len(gradient)}",
        " 0 0",
        " 0 0 0 0 0",
    ]
    return "\n".join(head + body) + "\n"
