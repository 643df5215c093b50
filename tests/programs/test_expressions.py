"""Functions as graphs of named operations: written graphs are read back, other data is rejected."""

import copy
import json
import random
import re
from pathlib import Path

import casadi
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models.programs.expressions import BINARY, STRUCTURAL, UNARY, Unwritable, write
from crosstrack.models.programs.interpreter import LARGEST, read, readable


def again(function):
    """Return `function` from a file, after the promise of the format is held."""
    data = write(function)
    found = read(json.loads(json.dumps(data, allow_nan=False)))
    assert write(found) == data
    return found


def same(function):
    assert again(function).serialize() == function.serialize()
    return True


@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX])
@pytest.mark.parametrize("name", sorted(UNARY | BINARY))
def test_every_operation_on_numbers(kind, name):
    code = getattr(casadi, f"OP_{name.upper()}")
    x, y = kind.sym("x", 2), kind.sym("y", 2)
    second = kind(3.7) if name == "constpow" else y
    made = kind.unary(code, x) if name in UNARY else kind.binary(code, x, second)
    function = casadi.Function("f", [x, y], [made], ["x", "y"], ["f"])
    assert name in {node[0] for node in write(function)["functions"][-1]["nodes"]}
    assert same(function)


def structural():
    """Return one expression for each operation on whole matrices, by its name."""
    x, sparse = casadi.MX.sym("x", 3, 3), casadi.MX.sym("s", casadi.Sparsity.upper(3))
    column = casadi.MX.sym("c", 4)
    own = casadi.MX.sym("own", 3, 3)
    inner = casadi.Function("inner", [own], [casadi.sin(own), casadi.trace(own)])
    changed = casadi.MX(x)
    changed.nz[[1, 2, 7]] = column[:3] * 2
    sparsity = casadi.Sparsity.lower(3)
    parts = casadi.horzsplit(x, [0, 1, 3])
    pieces = casadi.vertsplit(column, [0, 1, 4])
    found = {
        "bilin": casadi.bilin(x, column[:3], column[1:]),
        "call": casadi.plus(*inner.call([x], False, True)),
        "const": casadi.MX(casadi.DM([[1, 2.5, float("inf")]])) * x[0, :],
        "diagcat": casadi.diagcat(x, sparse),
        "dot": casadi.dot(x, x),
        "getnonzeros": x.nz[[0, 5, 2]] + x[:, 1] * 2 + casadi.sum1(casadi.vec(x[:2, :2])),
        "horzcat": casadi.horzcat(x, sparse),
        "horzrepmat": casadi.repmat(casadi.sin(x), 1, 3) * 2,
        "horzrepsum": casadi.repsum(casadi.horzcat(x, sparse), 1, 2),
        "horzsplit": parts[0] + casadi.sum2(parts[1]),
        "logsumexp": casadi.logsumexp(column),
        "mmax": casadi.mmax(x),
        "mmin": casadi.mmin(x),
        "mtimes": x @ sparse,
        "norm1": casadi.norm_1(casadi.vec(x)),
        "normf": casadi.norm_fro(x),
        "norminf": casadi.norm_inf(column),
        "project": casadi.project(x, sparsity) * 2,
        "rank1": casadi.rank1(casadi.MX(x), 2, column[:3], column[1:]),
        "reshape": casadi.reshape(casadi.sin(x), 1, 9) * 2,
        "setnonzeros": changed,
        "sparsity_cast": casadi.sparsity_cast(sparse, casadi.Sparsity.lower(3)) * 2,
        "transpose": casadi.sin(x).T * 2,
        "vertcat": casadi.vertcat(casadi.sin(column), column) * 2,
        "vertsplit": pieces[0] * pieces[1],
    }
    return [x, sparse, column], found


@pytest.mark.parametrize("name", sorted(STRUCTURAL))
def test_every_operation_on_matrices(name):
    arguments, found = structural()
    function = casadi.Function("f", arguments, [found[name]])
    nodes = [node[0] for one in write(function)["functions"] for node in one.get("nodes", ())]
    assert name in nodes
    assert same(function)


def test_all_of_them_in_one_function():
    arguments, found = structural()
    function = casadi.Function("f", arguments, list(found.values()))
    assert same(function)
    point = [casadi.DM(one.sparsity(), np.arange(1.0, 1 + one.nnz())) for one in arguments]
    for have, want in zip(again(function).call(point), function.call(point), strict=True):
        assert have.nonzeros() == want.nonzeros()


def tabled():
    grid = np.linspace(-2, 2, 9)
    spline = casadi.interpolant("spline", "bspline", [grid, grid], np.sin(np.arange(81)))
    lines = casadi.interpolant("lines", "linear", [grid], np.cos(np.arange(18)))
    x = casadi.MX.sym("x", 2)
    return casadi.Function("tabled", [x], [spline(x) * lines(x[0])], ["x"], ["y"])


@pytest.mark.parametrize("make", [tabled, lambda: tabled().expand()])
def test_tables_are_read_alike_before_and_after_they_are_differentiated(make):
    function = make()
    fresh = write(function)
    text = readable(function)[1].serialize()
    function.jacobian()
    assert write(function) == fresh
    assert readable(function)[0] == fresh
    assert readable(function)[1].serialize() == text
    assert function([0.3, -0.7]).nonzeros() == read(fresh)([0.3, -0.7]).nonzeros()


def test_maps_shared_functions_and_composed_outputs():
    x = casadi.SX.sym("x", 2)
    one = casadi.Function("one", [x], [casadi.sumsqr(x), x * x[0]], ["x"], ["f", "g"])
    z = casadi.MX.sym("z", 2, 5)
    f, g = one.map(5)(z)
    last = one.call([z[:, 0]], False, True)[0]
    results = [
        casadi.vertcat(f.T, last),
        casadi.horzcat(g, z),
        casadi.diagcat(casadi.vertcat(g, f), last),
        casadi.reshape(g, 5, 2),
        casadi.MX(2, 3),
        casadi.MX(casadi.DM([[0, 1], [2, 0]])),
        z,
    ]
    function = casadi.Function("f", [z, casadi.MX.sym("none", 0)], results)
    assert same(function)
    assert [item["kind"] for item in write(function)["functions"]] == ["scalar", "map", "matrix"]


def test_symbols_keep_their_names_and_an_argument_may_be_made_of_several():
    a, b = casadi.MX.sym("left", 2), casadi.MX.sym("right", 3)
    assert same(casadi.Function("f", [a], [a * 2], ["x"], ["y"]))
    s = casadi.vertcat(casadi.SX.sym("u"), casadi.SX.sym("v"))
    assert same(casadi.Function("f", [s], [s[0] * s[1]], ["x"], ["y"]))
    made = casadi.Function(
        "f", [casadi.vertcat(a, b)], [casadi.dot(a, b[:2]), b], ["x"], ["y", "z"]
    )
    point = [1.0, 2.0, 3.0, 4.0, 5.0]
    data, found = readable(made)
    assert [one.full().tolist() for one in found(point)] == [[[11.0]], [[3.0], [4.0], [5.0]]]
    assert readable(found)[0] == data


@pytest.mark.parametrize(
    ("name", "formulation"),
    [
        ("optimal-control/goddard-phases", "hermite-simpson"),
        ("optimal-control/cart-pole", "paper"),
        ("time-allocation/walk-20", None),
    ],
)
def test_programs_are_written_smaller_than_by_casadi(name, formulation):
    program = ct.load(name).formulate(formulation).program
    for function in (program.function, program.derivatives, program.hessian):
        assert same(function)
        text = json.dumps(write(function))
        assert len(text) < 0.8 * len(function.serialize())


def test_symbols_shared_by_functions_are_distinguished():
    x, z = casadi.SX.sym("x"), casadi.MX.sym("z")
    one, two = (casadi.Function(name, [x], [casadi.sin(x)]) for name in ("one", "two"))
    function = casadi.Function("f", [z], [one(z) * two(z)])
    data, found = readable(function)
    assert found.serialize() != function.serialize()  # which refers to the same symbol twice
    assert readable(found)[0] == data and found(0.7) == function(0.7)
    assert readable(found)[1].serialize() == found.serialize()


def test_unsupported_operations_are_not_written():
    x = casadi.MX.sym("x")
    root = casadi.rootfinder("root", "newton", {"x": x, "g": x**3 - 2})
    function = casadi.Function("f", [x], [root(x0=x)["x"]])
    with pytest.raises(Unwritable, match="Newton"):
        write(function)
    assert readable(function) == (function.serialize(), function)


def test_the_page_lists_all_operations():
    page = (Path(__file__).parents[2] / "docs" / "explanation" / "files.md").read_text("utf-8")
    table = page.partition("| operations | operands |")[2].partition("\n\n")[0]
    firsts = [line.split("|")[1] for line in table.splitlines()[2:]]
    listed = [name for cell in firsts for name in re.findall("`([a-z0-9_]+)`", cell)]
    assert sorted(listed) == sorted(UNARY | BINARY | set(STRUCTURAL))


# -- external data -------------------------------------------------------------------------------


def one(nodes, kind="matrix", *, shape=(1, 1), values=None, out=None, **changes):
    """Return the graph of one function of one argument."""
    return {
        "graph": 1,
        "functions": [
            {
                "kind": kind,
                "name": "f",
                "inputs": [{"name": "x", "shape": list(shape)}],
                "outputs": [
                    {
                        "name": "y",
                        "shape": list(out or shape),
                        "values": [len(nodes)] if values is None else values,
                    }
                ],
                "nodes": nodes,
                **changes,
            }
        ],
    }


SINE = [["sin", 0]]
DEEP = [one(SINE)["functions"][0]] + [one([["call", 0, k]])["functions"][0] for k in range(200)]
DOUBLE = [one(SINE, "scalar")["functions"][0]] + [
    one([["call", 0, k], ["call", 1, k]])["functions"][0] for k in range(30)
]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (7, "function: must be an object, got 7"),
        ({}, "key 'graph' is missing"),
        ({**one(SINE), "more": 1}, "unknown key 'more'"),
        ({**one(SINE), "graph": 2}, "graph must be version 1, got 2"),
        ({"graph": 1, "functions": []}, "1 function at least"),
        ({"graph": 1, "functions": [[]]}, "kind must be one of scalar, matrix, map, table"),
        (one([["eval", 0]]), r"functions\[0\].nodes\[0\]: unknown operation 'eval'"),
        (one([["printme", 0, 0]]), "unknown operation 'printme'"),
        (one([["monitor", 0]], "scalar"), "must be an operation on numbers"),
        (one([["sin", 1]]), r"a value must be a whole number >= 0 and < 1, got 1"),
        (one([["sin", -1]], "scalar"), "a value must be a whole number >= 0 and < 1, got -1"),
        (one([["sin", 0.0]]), "got 0.0"),
        (one([["sin", True]]), "got True"),
        (one([["sin", 0, 0]]), "sin takes 1 values"),
        (one([["sin", 0, 0]], "scalar"), "must be an operation on numbers and what it takes"),
        (one(["sin"]), r"must be \[operation"),
        (one([["const", [1, 1], "Infinity"]]), '"inf", "-inf" or "nan"'),
        (one([["const", 10**400]], "scalar"), "got 1000"),
        (one([["const", [2, 1], [1.0]]]), "numbers must be 2, got 1"),
        (one([["call", 0, 0]]), "a function must be a whole number >= 0 and < 0"),
        (one(SINE, shape=(10**6, 10**6)), f"more than {LARGEST} entries"),
        (one(SINE, "scalar", shape=(10**4, 10**3)), f"more than {LARGEST} entries"),
        (one(SINE, shape=(2**40, 1)), "rows and columns must be a whole number"),
        (one(SINE, shape=(2**31 - 1, 1, [0, 0], [])), f"more than {LARGEST} entries"),
        (one([["horzrepmat", 0, 10**4], ["horzrepmat", 1, 10**4]]), f"more than {LARGEST}"),
        (one([["horzcat", k, k] for k in range(60)]), f"more than {LARGEST} entries"),
        ({"graph": 1, "functions": DOUBLE}, f"more than {LARGEST} entries"),
        ({"graph": 1, "functions": DEEP}, "nested more than 100 deep"),
        (
            {"graph": 1, "functions": [*DOUBLE[:1], {"kind": "map", "of": 0, "times": 10**7}]},
            f"more than {LARGEST} entries",
        ),
        (one([["getnonzeros", 0, [1, 1], [1]]]), "places must be a whole number >= 0 and < 1"),
        (
            one([["getnonzeros", 0, [1, 1], {"start": 0, "stop": 9, "step": 1}]]),
            "stop must be a whole number >= 0 and < 2",
        ),
        (one([], shape=(2, 2, [0, 2, 1], [0])), "colind must be a whole number|colind must"),
        (one([], shape=(2, 1, [0, 2], [1, 0])), "rows must increase"),
        (one([], shape=(2, 1, [0, 1], [2])), "row must be a whole number >= 0 and < 2"),
        (one(SINE, values=[2]), "a value must be a whole number >= 0 and < 2"),
        (one(SINE, values=[0, 1]), "values must hold 1 value"),
        (one(SINE, out=(2, 1)), "values must hold 1 value, of the shape given"),
        (one(SINE, "scalar", values=[]), "a shape with 1 entries is given 0"),
        (one([["mtimes", 0, 0, 0]], shape=(2, 3)), r"nodes\[0\]: no valid function"),
        (one(SINE, name="no name"), "no valid function"),
        (one(SINE, name=7), "must be a string, got 7"),
        (one([["horzsplit", 0, [0, 5]]]), "offsets must be a whole number"),
        (one([["horzrepmat", 0, 0]]), "times must be >= 1, got 0"),
        (one([["horzrepsum", 0, 0]]), "times must be >= 1, got 0"),  # CasADi divides by it
        (one([["horzrepsum", 0, 2]]), "1 columns are no 2 blocks"),
        (
            {
                "graph": 1,
                "functions": [
                    {"kind": "table", "name": "t", "method": "a", "grid": [], "numbers": []}
                ],
            },
            "method must be linear or bspline, got 'a'",
        ),
        (
            {
                "graph": 1,
                "functions": [
                    {
                        "kind": "table",
                        "name": "t",
                        "method": "linear",
                        "grid": [[0, 1]],
                        "numbers": [1],
                    }
                ],
            },
            "1 numbers do not fit a grid of 2 points",
        ),
    ],
)
def test_bad_graphs_name_the_place(data, message):
    with pytest.raises(InvalidData, match=message) as caught:
        read(data, "function")
    assert caught.value.field == "function" and str(caught.value).startswith("function")


def places(data, path=()):
    """Yield the path of every value inside `data`."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


def mutated(data, draw):
    found = copy.deepcopy(data)
    *path, key = draw.choice(list(places(found)))
    owner = found
    for part in path:
        owner = owner[part]
    junk = [None, -1, 0, 1, 3, 2**31, 10**30, 1e308, "", "sin", "call", [], {}, [[0]], True, 0.5]
    how = draw.randrange(4)
    if how == 0:
        del owner[key]
    elif how == 1 and isinstance(owner, list):
        owner.insert(key, copy.deepcopy(draw.choice(owner)))
    elif how == 2 and isinstance(owner[key], int):
        owner[key] += draw.choice([-2, -1, 1, 2, 7])
    else:
        owner[key] = draw.choice(junk)
    return found


@pytest.mark.parametrize("count", [50, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("which", range(4))
def test_mutated_graphs_are_read_or_refused(which, count):
    arguments, found = structural()
    x = casadi.SX.sym("x", 3)
    scalar = casadi.Function("f", [x], [casadi.sin(x) @ x.T, casadi.fmax(x, 0.5)])
    data = write(
        [
            scalar,
            casadi.Function("f", arguments, list(found.values())),
            tabled(),
            scalar.map(4),
        ][which]
    )
    draw = random.Random(which)
    refused = 0
    for _ in range(count):
        try:
            function = read(json.loads(json.dumps(mutated(data, draw))))
            point = [casadi.DM.ones(function.sparsity_in(k)) for k in range(function.n_in())]
            function.call(point)
            readable(function)
        except InvalidData:
            refused += 1
    assert refused > 0.27 * count
