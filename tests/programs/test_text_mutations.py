"""Readers of QPLIB and CBF: drawn files, and damaged files beside a second reader."""

import random

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from text_formats import BINARY, MIP, MIXED, QP, SDP, assert_same_cbf, assert_same_qplib, read

from crosstrack.errors import InvalidData, UnsupportedFormulation

NUMBERS = st.one_of(st.integers(-3, 3), st.sampled_from([0.1, -1e-7, 2.5e9, 1 / 3]))


@st.composite
def qplibs(draw):
    """Draw the fields of a program, and its text."""
    n, m = draw(st.integers(1, 4)), draw(st.integers(0, 3))
    kind = (
        draw(st.sampled_from("LDC")) + draw(st.sampled_from("CBMIG")) + draw(st.sampled_from("BL"))
    )
    sign = draw(st.sampled_from([1, -1]))
    lines = ["drawn", kind, "minimize" if sign > 0 else "maximize", n]

    def vector(size, values):
        default, others = draw(values), draw(st.dictionaries(st.integers(1, max(size, 1)), values))
        others = others if size else {}
        lines.extend([default, len(others), *(f"{k} {v!r}" for k, v in others.items())])

    def matrix(rows, columns, triangle=False):
        places = [(i, j) for i in range(rows) for j in range(i + 1 if triangle else columns)]
        entries = draw(st.dictionaries(st.sampled_from(places), NUMBERS)) if places else {}
        lines.extend([len(entries), *(f"{i + 1} {j + 1} {v!r}" for (i, j), v in entries.items())])

    lines += [m] if kind[2] == "L" else []
    if kind[0] == "D":
        values = draw(st.lists(st.integers(0, 3), min_size=n, max_size=n))
        lines += [n, *(f"{k + 1} {k + 1} {sign * v}" for k, v in enumerate(values))]
    elif kind[0] == "C":
        root = np.array(draw(st.lists(st.integers(-2, 2), min_size=n * n, max_size=n * n)))
        hessian = sign * root.reshape(n, n) @ root.reshape(n, n).T
        places = [(i, j) for i in range(n) for j in range(i + 1) if hessian[i, j]]
        lines += [len(places), *(f"{i + 1} {j + 1} {hessian[i, j]}" for i, j in places)]
    vector(n, NUMBERS)
    lines.append(draw(NUMBERS))
    if kind[2] == "L":
        matrix(m, n)
    lines.append("1e20")
    low, high = (
        st.one_of(st.integers(-3, 0), st.just(-1e20)),
        st.one_of(st.integers(1, 3), st.just(1e30)),
    )
    if kind[2] == "L":
        vector(m, low)
        vector(m, high)
    if kind[1] == "M":
        low, high = st.just(0), st.just(1)
    if kind[1] != "B":
        vector(n, low)
        vector(n, high)
    if kind[1] in "MG":
        vector(n, st.integers(0, 2))
    for size in (n, m, n) if kind[2] == "L" else (n, n):
        vector(size, NUMBERS)
    return "\n".join(map(str, [*lines, 0, 0])) + "\n"


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(qplibs())
def test_reads_every_drawn_qplib(tmp_path, text):
    assert_same_qplib(read(tmp_path, text, ".qplib"), text)


@st.composite
def cbfs(draw):
    """Draw the text of a program with any cones."""
    small = st.integers(0, 3)
    kinds = st.sampled_from(["F", "L+", "L-", "L=", "Q", "QR", "EXP"])
    lines = ["VER", draw(st.integers(1, 4)), "OBJSENSE", draw(st.sampled_from(["MIN", "MAX"]))]
    sizes = {}

    def scalars(section, least):
        cones = draw(st.lists(st.tuples(kinds, small), min_size=least, max_size=3))
        cones = [(k, {"EXP": 3, "QR": d + 2, "Q": d + 1}.get(k, d + least)) for k, d in cones]
        sizes[section] = sum(d for _, d in cones)
        lines.extend([section, f"{sizes[section]} {len(cones)}", *(f"{k} {d}" for k, d in cones)])

    def matrices(section):
        sizes[section] = draw(st.lists(st.integers(1, 3), max_size=2))
        lines.extend([section, len(sizes[section]), *sizes[section]])

    scalars("VAR", 1)
    matrices("PSDVAR")
    scalars("CON", 0)
    matrices("PSDCON")

    def coefficients(section, places):
        entries = (
            draw(st.dictionaries(st.sampled_from(places), NUMBERS, max_size=5)) if places else {}
        )
        lines.extend([section, len(entries)])
        for place, entry in entries.items():
            lines.append(" ".join(map(str, place)) + f" {entry!r}")

    def triangles(section):
        orders = enumerate(sizes[section])
        return [(k, r, c) for k, d in orders for r in range(d) for c in range(r + 1)]

    x, g = range(sizes["VAR"]), range(sizes["CON"])
    coefficients("OBJFCOORD", triangles("PSDVAR"))
    coefficients("OBJACOORD", [(j,) for j in x])
    lines += ["OBJBCOORD", draw(NUMBERS)]
    coefficients("FCOORD", [(i, *place) for i in g for place in triangles("PSDVAR")])
    coefficients("ACOORD", [(i, j) for i in g for j in x])
    coefficients("BCOORD", [(i,) for i in g])
    coefficients("HCOORD", [(k, j, r, c) for k, r, c in triangles("PSDCON") for j in x])
    coefficients("DCOORD", triangles("PSDCON"))
    return "\n".join(map(str, lines)) + "\n"


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(cbfs())
def test_reads_every_drawn_cbf(tmp_path, text):
    assert_same_cbf(read(tmp_path, text, ".cbf"), text)


FIELDS = (
    *("0", "1", "2", "3", "5", "-1", "12", "99", "nan", "inf", "-inf", "1e400", "1e308", "-1e308", "1e-320"),
    *("99999999999999999999", "1_0", "\u0663", "x", "#", "0x1", "1d3", "", "3 3", "L+", "Q", "QR", "EXP", "F"),
    *("VAR", "CON", "INT", "PSDCON", "CHANGE", "BCOORD", "QBN", "CIL", "LCB", "CML", "maximize", "1\r2", "\x00"),
)  # fmt: skip


def mutated(text, rng):
    """Return a text with one to three random changes of characters, fields or lines."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        lines = text.split("\n")
        k = rng.randrange(len(lines))
        change = rng.randrange(7)
        if change == 0:
            del lines[k]
        elif change == 1:
            lines.insert(k, lines[rng.randrange(len(lines))])
        elif change == 2:
            other = rng.randrange(len(lines))
            lines[k], lines[other] = lines[other], lines[k]
        elif change in (3, 4):
            fields = lines[k].split(" ")
            fields[rng.randrange(len(fields))] = rng.choice(FIELDS if change == 3 else FIELDS[:7])
            lines[k] = " ".join(fields)
        text = "\n".join(lines)
        place = rng.randrange(len(text) + 1)
        if change == 5:
            text = (
                text[:place]
                + rng.choice("0123456789-+.eE# \n\tQ\u00e9\u2028")
                + text[place + rng.randrange(2) :]
            )
        elif change == 6 and rng.random() < 0.2:
            text = text[:place]
    return text


@pytest.mark.parametrize("count", [200, pytest.param(600, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("suffix", "texts", "compare"),
    [
        (".qplib", (QP, MIP, BINARY), assert_same_qplib),
        (".cbf", (SDP, MIXED), assert_same_cbf),
    ],
)
def test_mutated_files_are_refused_or_read_like_a_second_reader(
    tmp_path, suffix, texts, compare, count
):
    rng = random.Random(32)
    accepted = refused = 0
    for number in range(count):
        text = mutated(texts[number % len(texts)], rng)
        try:
            program = read(tmp_path, text, suffix)
        except (InvalidData, UnsupportedFormulation) as error:
            refused += str(tmp_path) in str(error)
            continue
        accepted += 1
        compare(program, text)
    # Each message names the file.
    assert accepted + refused == count
    assert min(accepted, refused) > count / 12
