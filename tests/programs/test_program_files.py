"""Files in MPS, LP and NL format: same program as other readers, and refusals that name the line."""

import gzip
import random
from pathlib import Path

import numpy as np
import pytest
import second_readers
from program_texts import LP, MPS, NL, QUADRATIC_LP, QUADRATIC_MPS, random_nl

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.programs import highs_files, nl_file
from crosstrack.models import MixedIntegerProgram

from .test_text_mutations import mutated

PUBLIC = Path(__file__).resolve().parents[3] / "shared" / "data" / "programs" / "mps"
NAMES = sorted(path.name for path in PUBLIC.glob("*.mps"))
INF = np.inf


@pytest.fixture
def in_process(monkeypatch):
    """Read with the libraries in this process: starting another one takes half a second."""

    def read_here(reader, path, raw, suffix):
        copy = path.with_name("copy" + suffix)
        copy.write_bytes(raw)
        try:
            return (nl_file if reader == "nl" else highs_files).arrays_of_file(copy)
        except (InvalidData, RuntimeError) as error:
            raise InvalidData(f"{path}: {error}") from None

    monkeypatch.setattr(highs_files, "read_apart", read_here)
    monkeypatch.setattr(nl_file, "read_apart", read_here)


def load(folder, suffix, text):
    path = folder / f"program.{suffix}"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return ct.load(path)


@pytest.mark.skipif(
    not NAMES, reason="the public programs are in ../shared/data/programs, which is absent"
)
def test_public_files_equal_a_second_reader(in_process, tmp_path):
    pytest.importorskip("gurobipy", reason="Gurobi is not installed")
    pytest.importorskip("pyscipopt", reason="SCIP is not installed")
    for name in NAMES:
        # Beside the copy of the file that the library reads.
        copy = tmp_path / name
        copy.write_bytes((PUBLIC / name).read_bytes())
        program = second_readers.of_program(ct.load(copy))
        assert program == second_readers.of_gurobi(copy), name
        # SCIP makes a row of a quadratic objective.
        if copy.stat().st_size < 20_000 and not program["products"]:
            assert program == second_readers.of_scip(copy), name


@pytest.mark.parametrize(
    ("suffix", "text"),
    [("mps", MPS), ("mps", QUADRATIC_MPS), ("lp", LP), ("lp", QUADRATIC_LP)],
    ids=["mps", "quadratic mps", "lp", "quadratic lp"],
)
def test_every_feature_equals_a_second_reader(suffix, text, in_process, tmp_path):
    pytest.importorskip("gurobipy", reason="Gurobi is not installed")
    program = second_readers.of_program(load(tmp_path, suffix, text))
    assert program == second_readers.of_gurobi(tmp_path / f"program.{suffix}")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        # HiGHS and SCIP write a column without coefficients in the bounds alone.
        ("z = 2.5", "z = 2.5\n unused <= 3\n other free"),
        ("Subject To\n c1: x + y - z >= 1\n c2: x - z <= 4\n", ""),
        ("x - z <= 4", "<= 4"),
        ("x - z <= 4", "x - z <= 1e+100"),
    ],
    ids=["column in bounds alone", "no rows", "empty row", "infinite side"],
)
def test_lp_files_that_all_readers_read_alike(old, new, in_process, tmp_path):
    pytest.importorskip("gurobipy", reason="gurobipy is not installed")
    pytest.importorskip("pyscipopt", reason="pyscipopt is not installed")
    text = changed(QUADRATIC_LP, "[ 4 x ^ 2 + 2 x * y + 3 y ^ 2 - x * z + 5 z ^ 2 ] / 2", "3 z")
    program = second_readers.of_program(load(tmp_path, "lp", changed(text, old, new)))
    assert program == second_readers.of_gurobi(tmp_path / "program.lp")
    assert program == second_readers.of_scip(tmp_path / "program.lp")


@pytest.mark.parametrize("count", [60, pytest.param(600, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("suffix", "texts"), [("mps", (MPS, QUADRATIC_MPS)), ("lp", (LP, QUADRATIC_LP))]
)
def test_mutated_files_are_refused_or_equal_a_second_reader(
    suffix, texts, count, in_process, tmp_path
):
    pytest.importorskip("gurobipy", reason="Gurobi is not installed")
    rng, accepted, refused = random.Random(39), 0, 0
    for number in range(count):
        text = mutated(texts[number % 2], rng)
        try:
            program = second_readers.of_program(load(tmp_path, suffix, text))
        except InvalidData as error:
            refused += f"program.{suffix}" in str(error)
            continue
        accepted += 1
        # Gurobi reads coefficients from 1e100 on as infinite.
        if "1e308" not in text:
            assert program == second_readers.of_gurobi(tmp_path / f"program.{suffix}"), text
    # Each message names the file.
    assert accepted + refused == count
    assert min(accepted, refused) > count / 20


def test_mps_files_with_an_infinite_side(in_process, tmp_path):
    """Gurobi writes it for a row without a side; the row has no range then."""
    pytest.importorskip("gurobipy", reason="gurobipy is not installed")
    text = changed(MPS, "rhs cost 12 limit 4", "rhs cost 12 limit 1e+100")
    with pytest.raises(InvalidData, match=r"line 25, .*the side of row limit is infinite"):
        load(tmp_path, "mps", text)
    text = changed(text, "range limit 2.5 demand 3", "range demand 3")
    program = second_readers.of_program(load(tmp_path, "mps", text))
    assert program == second_readers.of_gurobi(tmp_path / "program.mps")


def test_an_mps_file_has_the_documented_meaning(tmp_path):
    program = load(tmp_path, "mps", MPS)
    assert program.name == "program"
    assert program.maximise
    assert list(program.columns[0].labels) == ["x", "y", "z", "count", "w", "v"]
    assert list(program.rows[0].labels) == ["limit", "demand", "balance", "span"]
    # The cost is that of a minimisation, and the constant minus the right-hand side.
    np.testing.assert_array_equal(program.cost, [-1, 2, 0, 0, 0, 0])
    assert program.offset == 12
    np.testing.assert_array_equal(program.row_lower, [1.5, -2, 3, -4])
    np.testing.assert_array_equal(program.row_upper, [4, 1, 3, 0])
    # An integer column without bounds is binary.
    np.testing.assert_array_equal(program.integral, [0, 1, 1, 1, 0, 0])
    np.testing.assert_array_equal(program.column_lower, [0, 0, 0, 2, -INF, 2.5])
    np.testing.assert_array_equal(program.column_upper, [INF, 5, 1, INF, -1, 2.5])


def test_quadratic_objectives_have_the_documented_meaning(in_process, tmp_path):
    program = load(tmp_path, "mps", QUADRATIC_MPS)
    point = np.array([1.0, 2, 0, 3, -2, 2.5])
    quadratic = (4 * 1 + 2 * 1 * 1 * -2 + 3 * 4 + 0.5 * 6.25) / 2
    assert program.objective(point) == pytest.approx(quadratic + 1 - 2 * 2 - 12)
    program = load(tmp_path, "lp", QUADRATIC_LP)
    x, y, z = 1.0, -2.0, 2.5
    expected = x + 2 * y + (4 * x**2 + 2 * x * y + 3 * y**2 - x * z + 5 * z**2) / 2
    assert program.objective(np.array([x, y, z])) == pytest.approx(expected)
    with pytest.raises(InvalidData, match="to the name y: add a blank"):  # Gurobi reads "y+"
        load(tmp_path, "lp", changed(QUADRATIC_LP, "x * y +", "x * y+"))
    nonconvex = QUADRATIC_LP.replace("4 x ^ 2", "- 4 x ^ 2")
    with pytest.raises(InvalidData, match=r"program\.lp: hessian"):
        load(tmp_path, "lp", nonconvex)


@pytest.mark.parametrize("suffix", ["mps", "lp"])
def test_our_own_texts_give_the_same_program(suffix, in_process, tmp_path):
    program = MixedIntegerProgram(
        cost=[-5.0, 0.1, -3.0, 0.0],
        matrix=[[2.0, 3.0, 1.0, 0.0], [4.0, 1 / 3, 0.0, 1e-11], [1.0, 0.0, 2.0, -1e15]],
        row_lower=[-INF, 1.0, -2.0],
        row_upper=[5.0, INF, -2.0],
        column_lower=[0.0, -INF, -INF, -7.5],
        column_upper=[1.0, INF, 2.0, INF],
        integral=[True, False, True, False],
        offset=7.25,
    )
    again = load(tmp_path, suffix, program.to_mps() if suffix == "mps" else program.to_lp())
    for name in (
        "cost",
        "row_lower",
        "row_upper",
        "column_lower",
        "column_upper",
        "integral",
        "offset",
    ):
        np.testing.assert_array_equal(getattr(again, name), getattr(program, name), err_msg=name)
    np.testing.assert_array_equal(again.matrix.toarray(), program.matrix.toarray())


def test_compressed_files_and_numbers_of_lines_in_them(in_process, tmp_path):
    path = tmp_path / "program.mps.gz"
    path.write_bytes(gzip.compress(MPS.encode()))
    assert ct.load(path).digest == load(tmp_path, "mps", MPS).digest
    path.write_bytes(gzip.compress(MPS.replace("limit 2.5", "limit 2.5x", 1).encode()))
    with pytest.raises(InvalidData, match=r"program\.mps\.gz, line 12, section COLUMNS: '2\.5x'"):
        ct.load(path)


def changed(text, old, new):
    assert text.count(old), old
    return text.replace(old, new, 1)


def damaged(suffix, base, *pairs):
    return [(suffix, base, *pair) for pair in pairs]


@pytest.mark.parametrize(
    ("suffix", "base", "old", "new", "message"),
    [
        *damaged(
            "mps",
            MPS,
            ("ENDATA", "SOS\n S1 s1\n    x:1\nENDATA", "special ordered sets of section SOS"),
            ("ENDATA", "INDICATORS\n IF limit y 1\nENDATA", "indicator constraints of section"),
            ("ENDATA", "QCMATRIX limit\n x x 1\nENDATA", "quadratic constraints of section"),
            ("ENDATA", "QSECTION limit\n x x 1\nENDATA", "quadratic constraints of section"),
            ("ENDATA", "CSECTION c 0 QUAD\n x\nENDATA", "cones of section CSECTION"),
            ("COLUMNS", "LAZYCONS\n L lazy\nCOLUMNS", "lazy constraints of section LAZYCONS"),
            ("ENDATA", "FOO\nENDATA", "section 'FOO' is unknown"),
            ("ENDATA", "", "ENDATA is missing"),
            ("MAX\n", "MAXIMUM\n", "'MAXIMUM' must be a section at the start of a line"),
            ("OBJSENSE\n    MAX", "*SENSE:Maximize", "only a comment names the maximisation"),
            (" UP bound y 5", " SC bound y 5", "line 28, section BOUNDS: semi-continuous"),
            (" MI bound w\n", "", "column w has the negative upper bound -1 and no lower bound"),
            (" LO bound count 2", " LO bound y 6", "the bounds of column y contradict"),
            (" LO bound count 2", " LO bound cont 2", "column cont is not defined"),
            (" LO bound count 2", " UP bound y 6", "y is infinite or defined twice"),
            (" LO bound count 2", " LO other count 2", "more than one vector"),
            (" LO bound count 2", " LO count count 2", "must consist of type, vector, column"),
            (" LO bound count 2", " LO bound count nan", "'nan' is not a number"),
            (" LO bound count 2", " LO bound count 1D0", "'1D0' is not a number"),
            (" LO bound count 2", " LI bound count 2.5", "not an integer"),
            (" range span -4", " range cost -4", "row cost has type N"),
            (" range span -4", " span -4", "must start with the name of the vector"),
            (" rhs demand -2", " rhs demnd -2", "line 23, section RHS: row demnd is not defined"),
            (" rhs demand -2", " rhs demand 1e20", "the side of row demand is infinite"),
            (" rhs demand -2", " rhs limit -2", "row limit is not defined, or has two entries"),
            (" rhs demand -2", " rhs other -2", "row other has type N"),
            (" z limit 1 other 4", " z limit 1 other", "one or two pairs"),
            (" z limit 1 other 4", " x limit 1 other 4", "column x is defined twice"),
            (" z limit 1 other 4", " z limit 1e400", "outside the range"),
            (" E span\n", " E limit\n", "row limit is defined twice"),
            (" E span\n", " E span two\n", "a row must consist"),
            (" MARK 'MARKER' 'INTEND'\n", "", "marker INTORG without INTEND"),
            (" z limit", "z limit", "neither a section nor an indented line"),
            ("RHS\n", "RANGES\n range limit 1\nRHS\n", "RHS is out of order"),
            (" z limit", " \0z limit", "line 16: byte 0x00 is a control character"),
        ),
        *damaged(
            "mps",
            QUADRATIC_MPS,
            (" x w 1", " x w 1\n w x 1", "the entry w, x is defined twice"),
            ("QUADOBJ", "QMATRIX", "the entry x, w is not symmetric"),
            (" x w 1", " x u 1", "a column of the entry x, u is not defined"),
        ),
        *damaged(
            "lp",
            LP,
            ("End", "SOS\n s: S1:: x:1 y:2\nEnd", "line 20, section SOS: special ordered sets"),
            ("End", "Semi-Continuous\n y\nEnd", "section Semi-Continuous: semi-continuous columns"),
            ("Bounds", "Lazy Constraints\n l: x <= 3\nBounds", "lazy constraints"),
            ("Bounds", "General Constraints\n z = MAX(x, y)\nBounds", "general constraints"),
            (" x + v = 3", " v = 1 -> x = 3", "line 9: indicator constraints"),
            (" x + v = 3", " x+ v = 3", "to the name x: add a blank"),
            (" x + v = 3", " [ x ^ 2 ] <= 3", "quadratic constraints are not supported"),
            (" x + v = 3", " x + v = 1e20", "an infinite right-hand side"),
            (" x + v = 3", " x + v >= 1e20", "an infinite right-hand side"),
            (" x + v = 3", " x + v + 1 = 3", "expected a term such as"),
            (" x + v = 3", " 1 <= x + v <= 3", "expected a term such as"),
            (" x + v = 3", " x + v < 3", "expected <=, >= or ="),
            (" x + v = 3", " x + v = 3 + y", "expected <=, >= or ="),
            (" x + v = 3", " x + v + x = 3", "column x occurs twice"),
            (" x + v = 3", " first: x + v = 3", "row first is defined twice"),
            (" x + v = 3", " x + - v = 3", "expected a term such as"),
            (" x + v = 3", " x- - v = 3", "to the name x: add a blank"),
            (" x + v = 3", " x + v = nan", "expected <=, >= or ="),
            (" x + v = 3", " x + 2v = 3", "expected a term such as"),
            (" x + v = 3", " x + info = 3", "'info' is a keyword or a number for HiGHS"),
            (" x + v = 3", " x + bin = 3", "'bin' is a keyword"),
            ("Maximize", "Maximise", "the keyword Minimize or Maximize is missing"),
            ("Maximize\n", "max: ", "the keyword Minimize or Maximize is missing"),
            ("End", "", "the keyword End is missing"),
            ("End", "End\nz", "text after End"),
            ("Binary", "General", "the section occurs twice"),
            (" y <= 8", " y <= -8", "column y has the negative upper bound -8"),
            (" y <= 8", " y <= 8\n y <= 9", "y is infinite or defined twice"),
            (" x + v = 3", " x + y[1] = 3", "'[1]' is a part of a name that HiGHS and SCIP"),
            ("Subject To", "Bounds", "expected a bound"),
            ("Maximize\n", "Bounds\n", "the section is out of order"),
            ("Subject To", "Bounds\n x <= 1\nSubject To", "the section is out of order"),
            (" y <= 8", " 9 <= y <= 8", "the bounds of column y contradict"),
            (" y <= 8", " v <= 8", "binary column v has other bounds"),
            (" z y", " z y u", "column u is in no row"),
            ("+ 4 v - 12", "+ 4 v - 12;", "expected"),
        ),
        *damaged(
            "nl",
            NL,
            ("g3", "b3", "the file is binary"),
            (" 3 2 1 1 1", " 3 2 1 1 1 1", "line 2, section header: logical is not supported"),
            (" 3 2 1 1 1", " 3 2 2 1 1", "several objectives"),
            (" 3 2 1 1 1", " 3 2 1 0 1", "ranges and equations differ"),
            ("\n 1 1\t#", "\n 1 1 1 0\t#", "complementarity is not supported"),
            (" 0 0 0 1", " 0 1 0 1", "functions is not supported"),
            (" 0 0 0 1", " 2 0 0 1", "network is not supported"),
            (" 0 1 0 0 0", " 0 3 0 0 0", "integer columns contradict"),
            (" 0 1 0 0 0", " 0 1 0 0", "line 7, section header: expected the 5 numbers binary integer"),
            (" 4 2\t#", " 5 2\t#", "nonzeros differ"),
            (" 3 2 1", " 999999999 2 1", "the numbers of the header exceed the length of the file"),
            ("C0\n", "F0 1 1 f\nC0\n", "imported functions are not supported"),
            ("C0\n", "S0 1 sosno\n0 1\nC0\n", "suffixes, such as those of special ordered sets"),
            ("C0\n", "L0\nn1\nC0\n", "logical constraints are not supported"),
            ("o44", "o47", "operator 47 (inverse hyperbolic function) is not supported"),
            ("o44", "o35", "operator 35 (if-then-else) is not supported"),
            ("n-1.5", "n-1.5abc", "'-1.5abc' is not a number"),
            ("n-1.5", "ninf", "'inf' is not a number"),
            ("n-1.5", "v4", "v4 is not defined"),
            ("4 3\n", "5 1 2\n", "complementarity is not supported"),
            ("0 -1 25", "0 25 -1", "the bounds contradict"),
            ("0 -1 25", "0 -1", "bounds must be"),
            ("1\n3\nJ0", "1\n2\nJ0", "segment k and the Jacobian differ in column 1"),
            ("C1\nn0\n", "", "precedes the expression"),
            ("J1 2\n1 -1\n2 2\n", "", "nonzeros differ"),
            ("J1 2\n1 -1\n", "J1 2\n2 -1\n", "index 2 occurs twice"),
            ("G0 2\n0 1\n2 -3\n", "G0 2\n0 1\n", "the file ends too early"),
            ("b\n0 -1 5\n2 0.25\n0 0 10\n", "", "segment b is missing"),
        ),
    ],
)  # fmt: skip
def test_damaged_files_are_refused_with_line_and_section(suffix, base, old, new, message, tmp_path):
    with pytest.raises(InvalidData) as caught:
        load(tmp_path, suffix, changed(base, old, new))
    assert message in str(caught.value)
    assert f"program.{suffix}, line " in str(caught.value)


def test_nl_files_equal_an_independent_evaluation(in_process, tmp_path):
    # White space and leading zeros do not change the direction of the objective.
    others = (changed(NL, "O0 1", line) for line in ("O0  1", "O0\t1", " O0 1", "O00 1 # goal"))
    for text in (NL, *others, *map(random_nl, range(25))):
        program = load(tmp_path, "nl", text)
        assert not second_readers.NlReader(tmp_path / "program.nl").differs(program), text


def test_names_of_an_nl_file_come_from_the_files_beside_it(in_process, tmp_path):
    (tmp_path / "program.col").write_text("alpha\nbeta\ngamma\n")
    (tmp_path / "program.row").write_text("range\nequation\n")
    program = load(tmp_path, "nl", NL)
    assert program.columns[0].labels == ("alpha", "beta", "gamma")
    assert program.rows[0].labels == ("range", "equation")
    assert program.maximise
    np.testing.assert_array_equal(program.integral, [False, False, True])


def test_a_file_that_the_library_refuses_is_named(in_process, tmp_path):
    """Coefficients below 1e-12 are the last ones that HiGHS drops."""
    with pytest.raises(InvalidData, match=r"program\.mps: .*1e-13.*ignored"):
        load(tmp_path, "mps", MPS.replace("-1e-3", "-1e-13"))


def test_a_crash_of_the_library_is_a_refusal(tmp_path):
    """CasADi's reader is recursive, and its stack overflows in its own process."""
    text = NL.replace("o43\no0\n", "o16\n" * 100_000 + "o43\no0\n")
    with pytest.raises(
        InvalidData, match=r"program\.nl: not readable, the process .* ended with -"
    ):
        load(tmp_path, "nl", text)


def test_texts_of_every_kind_end_in_a_program_or_a_refusal(in_process, tmp_path):
    """A few hundred faults; tests/benchmarks/programs/damaged_files.py makes more."""
    generator = np.random.default_rng(3)
    outcomes = set()
    for suffix, text in (("mps", MPS), ("lp", LP), ("nl", NL)):
        for _ in range(40):
            lines = text.encode().split(b"\n")
            first, second = generator.integers(len(lines), size=2)
            lines[first], lines[second] = lines[second], lines[first][: generator.integers(1, 30)]
            try:
                load(tmp_path, suffix, b"\n".join(lines))
                outcomes.add("program")
            except InvalidData as error:
                outcomes.add(f"program.{suffix}" in str(error))
    assert outcomes == {"program", True}
