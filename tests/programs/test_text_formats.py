"""Readers of QPLIB and CBF: optima, and refused content."""

import gzip
import tracemalloc

import cvxpy as cp
import numpy as np
import pytest
from text_formats import (
    BINARY,
    MIP,
    MIXED,
    QP,
    SDP,
    assert_same_cbf,
    assert_same_qplib,
    lines,
    read,
)

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models.programs import ConicProgram, MixedIntegerProgram, QuadraticProgram


def value(program, backend="clarabel"):
    return ct.solve(program, backend).value


def test_reads_a_convex_quadratic_program(tmp_path):
    program = read(tmp_path, QP, ".qplib")
    assert isinstance(program, QuadraticProgram)
    assert program.name == "EXAMPLE"
    assert_same_qplib(program, QP)
    x = cp.Variable(3)
    hessian = np.array([[2, -1, 0], [-1, 2, 0], [0, 0, 2]])
    objective = 0.5 * cp.quad_form(x, hessian) - 0.2 * x[0] - 0.4 * x[1] - 0.2 * x[2] + 0.5
    rows = [x[0] + x[1] >= 1, x[0] + x[2] >= 1, x >= 0, x <= [1, 2, 1]]
    optimum = cp.Problem(cp.Minimize(objective), rows).solve(solver="CLARABEL")
    assert value(program) == pytest.approx(optimum, abs=1e-6)
    assert program.row_name(1) == "c c2"
    assert ct.solve(program, "clarabel").values["x"].shape == (3,)


def test_reads_a_mixed_integer_program_with_names(tmp_path):
    program = read(tmp_path, MIP, ".qplib")
    assert isinstance(program, MixedIntegerProgram)
    assert_same_qplib(program, MIP)
    solution = ct.solve(program, "highs")
    # 2 x1 + x2 + x3 + x4 <= 6.5 with x2 integer and x4 binary: maximise 3 x1 - 2.5 x2 + x3 + x4 - 1.
    assert solution.value == pytest.approx(3 * 3.25 - 1)
    assert list(solution.values) == ["first", "x2", "third", "x4"]
    assert program.row_name(0) == "c capacity"


def test_reads_maximisation_of_a_concave_objective(tmp_path):
    text = QP.replace("minimize", "MAXIMIZE").replace("2.0\n", "-2.0\n").replace("2 1 -1", "1 2 1")
    program = read(tmp_path, text, ".qplib")
    minimum = read(tmp_path, QP.replace("-0.2\n", "0.2\n").replace("2 -0.4", "2 0.4"), ".qplib")
    text = text.replace("2 -2.0\n0\n", "2 2.0\n0\n")  # the bound of x2
    program = read(tmp_path, text, ".qplib")
    assert program.maximise
    assert value(program) == pytest.approx(-(value(minimum) - 0.5) + 0.5, abs=1e-6)


@pytest.mark.parametrize("ending", ["0\n", ""])
def test_reads_binary_quadratic_programs_without_constraints(tmp_path, ending):
    program = read(tmp_path, BINARY + ending, ".qplib")
    assert isinstance(program, QuadraticProgram)
    assert program.integral.all()
    assert_same_qplib(program, BINARY)


def test_reads_boxes_and_integers_of_mixed_files(tmp_path):
    box = "B\nDCB\nminimize\n2\n2\n1 1 2\n2 2 4\n-1\n0\n0\n1e20\n0\n0\n.25\n0\n0\n0\n0\n0\n0\n"
    program = read(tmp_path, box, ".qplib")
    assert_same_qplib(program, box)
    assert value(program) == pytest.approx(0.25**2 - 0.25 + 2 * 0.25**2 - 0.25, abs=1e-6)
    assert isinstance(
        read(tmp_path, box.replace("1 1 2\n2 2 4", "1 1 0\n2 2 0"), ".qplib"), MixedIntegerProgram
    )
    for kind, types in (("LMB", "0\n1\n2 1\n"), ("LIB", "")):
        text = f"M\n{kind}\nminimize\n2\n-1\n0\n0\n1e20\n0\n0\n1\n0\n{types}0\n0\n0\n0\n0\n"
        program = read(tmp_path, text, ".qplib")
        assert program.integral.tolist() == [kind == "LIB", True]
        assert_same_qplib(program, text)


def test_reads_the_example_of_the_cbf_specification(tmp_path):
    program = read(tmp_path, SDP, ".cbf")
    assert isinstance(program, ConicProgram)
    assert program.outline() == "2 rows, 9 columns, 1 semidefinite, 1 second-order cones"
    assert_same_cbf(program, SDP)
    matrix, x = cp.Variable((3, 3), PSD=True), cp.Variable(3)
    weights = np.array([[2, 1, 0], [1, 2, 1], [0, 1, 2]])
    rows = [
        cp.trace(matrix) + x[1] == 1,
        cp.sum(matrix) + x[0] + x[2] == 0.5,
        cp.SOC(x[1], cp.hstack([x[0], x[2]])),
    ]
    problem = cp.Problem(cp.Minimize(cp.trace(weights @ matrix) + x[1]), rows)
    solution = ct.solve(program, "clarabel")
    assert solution.value == pytest.approx(problem.solve(solver="CLARABEL"), abs=1e-6)
    assert solution.value == pytest.approx(0.705710, abs=1e-5)  # value in the manual of MOSEK
    assert solution.values["PSDVAR"] == pytest.approx(matrix.value[np.tril_indices(3)], abs=1e-4)
    assert program.column_name(4) == "PSDVAR PSDVAR 0[1, 0]"


def test_reads_matrix_constraints(tmp_path):
    text = (
        "VER\n1\nOBJSENSE\nMAX\nVAR\n2 1\nF 2\nPSDCON\n1\n3\nOBJACOORD\n2\n0 1\n1 1\n"
        "HCOORD\n4\n0 0 0 0 -1\n0 0 1 0 0.5\n0 1 1 1 -2\n0 1 2 0 1\n"
        "DCOORD\n4\n0 0 0 1\n0 1 1 2\n0 2 2 3\n0 2 1 0.25\n"
    )
    program = read(tmp_path, text, ".cbf")
    assert_same_cbf(program, text)
    x = cp.Variable(2)
    first = np.array([[-1, 0.5, 0], [0.5, 0, 0], [0, 0, 0]])
    second = np.array([[0, 0, 1], [0, -2, 0], [1, 0, 0]])
    constant = np.array([[1, 0, 0], [0, 2, 0.25], [0, 0.25, 3]])
    row = x[0] * first + x[1] * second + constant >> 0
    optimum = cp.Problem(cp.Maximize(cp.sum(x)), [row]).solve(solver="CLARABEL")
    assert value(program) == pytest.approx(optimum, abs=1e-6)


@pytest.mark.parametrize(
    ("cone", "ones", "optimum"),
    [("QR", "1; 2 1", 2**0.5), ("EXP", "2; 1 1; 2 1", np.e)],
    ids=["rotated", "exponential"],
)
@pytest.mark.parametrize("section", ["VAR", "CON"])
def test_reads_rotated_and_exponential_cones(tmp_path, cone, ones, optimum, section):
    """Minimise x + y with 2 x y >= 1, and x with exp(1) <= x."""
    count = int(ones[0])
    goal = "OBJACOORD; 2; 0 1; 1 1; " if cone == "QR" else "OBJACOORD; 1; 0 1; "
    if section == "VAR":
        fixed = "; ".join(f"{k} {line[0]} 1" for k, line in enumerate(ones.split("; ")[1:]))
        text = lines(
            f"VER; 2; OBJSENSE; MIN; VAR; 3 1; {cone} 3; CON; {count} 1; L= {count}; {goal}"
            f"ACOORD; {count}; {fixed}; BCOORD; {count}; "
            + "; ".join(f"{k} -1" for k in range(count))
        )
    else:
        free = 3 - count
        body = "; ".join(f"{k} {k} 1" for k in range(free))
        text = lines(
            f"VER; 2; OBJSENSE; MIN; VAR; {free} 1; F {free}; CON; 3 1; {cone} 3; {goal}"
            f"ACOORD; {free}; {body}; BCOORD; {ones}"
        )
    program = read(tmp_path, text, ".cbf")
    assert_same_cbf(program, text)
    assert value(program) == pytest.approx(optimum, abs=1e-5)


def test_reads_linear_and_mixed_integer_programs_from_cbf(tmp_path):
    text = (
        "VER\n1\nOBJSENSE\nMAX\nVAR\n3 2\nL+ 2\nL- 1\nINT\n1\n1\nCON\n2 2\nL- 1\nF 1\n"
        "OBJACOORD\n3\n0 3\n1 2\n2 1\nOBJBCOORD\n10\nACOORD\n3\n0 0 2\n0 1 1\n1 0 1\nBCOORD\n1\n0 -3.5\n"
    )
    program = read(tmp_path, text, ".cbf")
    assert isinstance(program, MixedIntegerProgram)
    assert_same_cbf(program, text)
    assert value(program, "highs") == pytest.approx(10 + 3 * 0.25 + 6)
    assert ct.solve(program, "highs").values["VAR"] == pytest.approx([0.25, 3, 0])


def test_reads_every_kind_of_cone(tmp_path):
    program = read(tmp_path, MIXED, ".cbf")
    assert_same_cbf(program, MIXED)
    assert [(block.name, block.kind, block.count) for block in program.cones] == [
        ("VAR 1", "exponential", 1), ("VAR 2", "second-order", 1), ("VAR 4", "second-order", 1),
        ("PSDVAR 0", "semidefinite", 1), ("PSDVAR 1", "semidefinite", 1), ("CON 4", "second-order", 1),
        ("CON 5", "exponential", 1), ("CON 6", "second-order", 1), ("PSDCON 0", "semidefinite", 1),
        ("PSDCON 1", "semidefinite", 1),
    ]  # fmt: skip


@pytest.mark.parametrize(("text", "suffix"), [(QP, ".qplib"), (SDP, ".cbf")])
def test_compression_line_ends_and_comments_change_nothing(tmp_path, text, suffix):
    program = read(tmp_path, text, suffix)
    (tmp_path / f"model{suffix}.gz").write_bytes(gzip.compress(text.encode()))
    others = [ct.load(tmp_path / f"model{suffix}.gz")]
    for changed in (
        text.replace("\n", "\r\n"),
        text.replace("\n", " # 1 2 3\x0b4\u20285\n\n#1\n"),
        "\ufeff" + text.replace(" ", "\t ").rstrip("\n"),
    ):
        others.append(read(tmp_path, changed, suffix))
    assert {other.digest for other in others} == {program.digest}


REFUSED_QPLIB = [
    ("CCL", "CCQ", UnsupportedFormulation, r"line 3: .*CCQ has quadratic constraints.*second-order"),
    ("1 1 2.0", "1 1 0.1", UnsupportedFormulation, "not convex.*smallest eigenvalue"),
    ("minimize", "maximize", UnsupportedFormulation, "not concave"),
    ("CCL", "CXL", InvalidData, "line 3: problem type"),
    ("CCL", "DCL", InvalidData, "line 9: .*diagonal"),
    ("minimize", "min", InvalidData, "line 4: sense"),
    ("3 # variables", "0", InvalidData, "line 5: number of variables must be an integer from 1"),
    ("3 # variables", "999999999999", InvalidData, "line 5: number of variables.*to 100000"),
    ("3 # variables", "3 4", InvalidData, "line 5: .*needs 1 fields"),
    ("2 1 -1", "2 1 nan", InvalidData, "line 9: .*finite"),
    ("2 1 -1", "2 1 1e400", InvalidData, "line 9: .*finite"),
    ("2 1 -1", "2 1 1_0", InvalidData, "line 9"),
    ("2 1 -1", "2 4 -1", InvalidData, "line 9: .*from 1 to 3"),
    ("2 1 -1", "+2 1 -1", InvalidData, "line 9"),
    ("2 1 -1", "2 1 \u0663", InvalidData, "line 9: value"),
    ("2 1 -1", "\u0662 1 -1", InvalidData, "line 9: index"),
    ("2 1 -1", "\u00b2 1 -1", InvalidData, "line 9: index"),
    ("3 3 2.0", "1 2 2.0", InvalidData, "line 11: .*repeats that of line 9"),
    ("2 3 1\n", "", InvalidData, "line 20"),
    ("1.0E+20", "0", InvalidData, "infinity must be positive"),
    ("1 3\n", "1 inf\n", InvalidData, "starting multiplier"),
    ("1E25", "-1E25", InvalidData, "row_upper"),
    ("0\n0\n0\n0\n", "0\n0\n0\n0\n7\n", InvalidData, "must end here"),
    ("0\n0\n0\n0\n", "0\n0\n", InvalidData, "the file ends before"),
    ("0\n0\n0\n0\n", "0\n0\n2\n1 a\n1 b\n0\n", InvalidData, "two names"),
    ("0\n0\n0\n0\n", "0\n0\n1\n1 x2\n0\n", InvalidData, "must differ"),
]  # fmt: skip


def check_refused(folder, text, changed, suffix, error, message):
    """Assert that reading the changed text raises the error with the file and the message."""
    assert changed != text
    with pytest.raises(error, match=message) as caught:
        read(folder, changed, suffix)
    assert str(caught.value).startswith(str(folder / f"model{suffix}"))


@pytest.mark.parametrize(("old", "new", "error", "message"), REFUSED_QPLIB)
def test_refuses_damaged_qplib(tmp_path, old, new, error, message):
    changed = new.join(QP.rsplit(old, 1)) if old.startswith("0\n") else QP.replace(old, new, 1)
    check_refused(tmp_path, QP, changed, ".qplib", error, message)


@pytest.mark.parametrize(
    ("kind", "types", "bounds", "message"),
    [
        ("LGB", "3\n0\n", "0\n0\n1\n0\n", "0, 1 or 2: variable 1"),
        ("LMB", "0\n1\n2 1\n", "0\n0\n5\n0\n", "other than 0 and 1: variable 2"),
        ("LMB", "0\n1\n2 2\n", "1\n0\n5\n0\n", "must contain 0 and 1: variable 2"),
    ],
)
def test_refuses_contradictory_types_of_variables(tmp_path, kind, types, bounds, message):
    text = f"M\n{kind}\nminimize\n2\n-1\n0\n0\n1e20\n{bounds}{types}0\n0\n0\n0\n0\n"
    with pytest.raises(InvalidData, match=message):
        read(tmp_path, text, ".qplib")


REFUSED_CBF = [
    ("CON\n11", "POWCONES\n1 2\n2\n0.5\n0.5\nCON\n11", UnsupportedFormulation, "line 21: POWCONES"),
    ("CON\n11", "POW*CONES\n1 2\n", UnsupportedFormulation, r"line 21: POW\*CONES"),
    ("EXP 3", "EXP* 3", UnsupportedFormulation, r"line 12: EXP\* has no equivalent here: pose dual"),
    ("EXP 3", "@0:POW 3", UnsupportedFormulation, "line 12: POW has"),
    ("EXP 3", "@0:POW* 3", UnsupportedFormulation, r"line 12: POW\* has"),
    ("EXP 3", "GMEANABS 3", UnsupportedFormulation, "line 12: GMEANABS has"),
    ("EXP 3", "SVECPSD 3", UnsupportedFormulation, "line 12: SVECPSD has"),
    ("PSDCON", "INT\n1\n0\nPSDCON", UnsupportedFormulation, "INT together with cones"),
    ("PSDCON", "OBJQUAD\nPSDCON", UnsupportedFormulation, "line 17: OBJQUAD"),
    ("1 0 0 5\n", "1 0 0 5\nCHANGE\n", UnsupportedFormulation, "CHANGE.*separate file"),
    ("EXP 3", "EXPO 3", InvalidData, "line 12: cone must be one of"),
    ("EXP 3", "PSD 3", InvalidData, "line 12: cone must be one of"),
    ("EXP 3", "EXP 4", InvalidData, "line 12: dimension of EXP"),
    ("QR 3", "QR 1", InvalidData, "line 13: dimension of QR"),
    ("Q 2", "Q 0", InvalidData, "line 15: dimension of Q"),
    ("F 2", "F 3", InvalidData, "line 16: the cones of VAR must have 12 entries, got 13"),
    ("VER\n4", "VER\n5", InvalidData, "line 2: version must be"),
    ("VER\n4\n", "", InvalidData, "line 1: VER must be the first"),
    ("OBJSENSE\nMAX\n", "", InvalidData, "without a section OBJSENSE"),
    ("MAX", "MAXIMUM", InvalidData, "line 4: OBJSENSE must be"),
    ("OBJBCOORD", "OBJBCORD", InvalidData, "unknown section 'OBJBCORD': did you mean 'OBJBCOORD'"),
    ("OBJBCOORD", "3 4", InvalidData, "unknown section"),
    ("OBJBCOORD\n3.5\n", "OBJBCOORD\n3.5\nOBJBCOORD\n3.5\n", InvalidData, "must occur once"),
    ("DCOORD\n2", "VER\n4\nDCOORD\n2", InvalidData, "must occur once"),
    ("1 0 0 5\n", "1 0 0 5\nINT\n1\n0\n", InvalidData, "INT must precede all coefficients"),
    ("PSDCON", "INT\n2\n0\n0\nPSDCON", InvalidData, "each variable once"),
    ("PSDCON", "INT\n1\n12\nPSDCON", InvalidData, "integer must be an integer from 0 to 11"),
    ("1 0 0 5\n", "1 1 0 5\n", InvalidData, "DCOORD: the order of PSDCON 1 is 1, got row"),
    ("1 0 0 -2\n", "0 0 1 -2\n", InvalidData, "OBJFCOORD repeats that of line 32"),
    ("0 -1\n1 -1.5", "0 -1\n0 -1.5", InvalidData, "OBJACOORD repeats"),
    ("0 -1\n1 4", "0 -inf\n1 4", InvalidData, "finite"),
    ("DCOORD\n2", "DCOORD\n3", InvalidData, "the file ends before entry of DCOORD"),
    ("DCOORD\n2", "DCOORD\n1", InvalidData, "unknown section"),
    ("DCOORD\n2", "DCOORD\n-2", InvalidData, "number of DCOORD entries"),
    ("PSDVAR\n2\n2\n1", "PSDVAR\n2\n2\n60000", InvalidData, "line 8: .*at most 2500000 entries"),
    ("VAR\n12", "VAR\n1000000000", InvalidData, "line 10: number of VAR entries.*100000"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "error", "message"), REFUSED_CBF)
def test_refuses_damaged_cbf(tmp_path, old, new, error, message):
    check_refused(tmp_path, MIXED, MIXED.replace(old, new, 1), ".cbf", error, message)


@pytest.mark.parametrize(
    "late", ["CON; 1 1; L= 1", "PSDVAR; 1; 1", "VAR; 1 1; F 1", "PSDCON; 1; 1"]
)
def test_refuses_sizes_after_coefficients(tmp_path, late):
    first = "PSDCON; 0; VAR; 1 1; F 1" if late.startswith("CON") else "CON; 1 1; L= 1"
    text = lines(f"VER; 1; OBJSENSE; MIN; {first}; OBJBCOORD; 2; {late}")
    with pytest.raises(InvalidData, match=f"section {late.split(';')[0]} must precede"):
        read(tmp_path, text, ".cbf")


def test_refuses_files_without_variables(tmp_path):
    for text in ("VER\n1\nOBJSENSE\nMIN\n", "VER\n1\nOBJSENSE\nMIN\nVAR\n0 0\n", "", "\x00"):
        with pytest.raises(InvalidData):
            read(tmp_path, text, ".cbf")
        with pytest.raises(InvalidData):
            read(tmp_path, text, ".qplib")


@pytest.mark.parametrize("suffix", [".qplib", ".cbf"])
def test_declared_sizes_need_little_memory(tmp_path, monkeypatch, suffix):
    text = QP.replace("3 # variables", "100000").replace("2 3 1\n", "2 3 x\n")
    if suffix == ".cbf":
        sizes = "VAR; 100000 1; F 100000; PSDVAR; 2; 2000; 900; CON; 100000 1; F 100000"
        text = lines(f"VER; 1; OBJSENSE; MIN; {sizes}; BCOORD; 9")
    # The buffer for reading has the size of the largest file.
    monkeypatch.setattr("crosstrack.instances.programs.lines.read_raw", lambda _: text.encode())
    (tmp_path / f"model{suffix}").write_text(text, "utf-8")
    tracemalloc.start()
    try:
        with pytest.raises(InvalidData, match=r"the file ends|index of constraint matrix|finite"):
            ct.load(tmp_path / f"model{suffix}")
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def test_refuses_long_lines(tmp_path):
    with pytest.raises(InvalidData, match="line 1: a line must have at most 65536 characters"):
        read(tmp_path, "1 " * 40_000, ".cbf")
