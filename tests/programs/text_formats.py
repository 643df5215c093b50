"""Texts in QPLIB and CBF format, and naive readers of both that check nothing."""

import numpy as np

import crosstrack as ct


def read(folder, text, suffix):
    """Return the program in a file with the text."""
    file = folder / f"model{suffix}"
    file.write_text(text, encoding="utf-8", newline="")
    return ct.load(file)


def lines(text):
    """Return a text with a line break instead of each semicolon."""
    return text.replace("; ", "\n") + "\n"


#: Two rows, three columns, quadratic objective.
QP = lines(
    "! written by hand; EXAMPLE # name; CCL; minimize; 3 # variables; 2 # constraints; "
    "4 # quadratic terms; 1 1 2.0; 2 1 -1; 2 2 2.0; 3 3 2.0; -0.2; 1; 2 -0.4; 0.5; 4; 1 1 1.0; "
    "1 2 1; 2 1 1; 2 3 1; 1.0E+20; 1; 0; 1E25; 0; % bounds; ; 0; 0; 1 #default; 1; 2 2.0; 0; 0; "
    "0; 1; 1 3; 0; 0; 0; 0"
)
#: Integral columns by type, some names.
MIP = lines(
    "MIP; LGL; maximize; 4; 1; 1; 2; 1 3; 2 -2.5; -1; 4; 1 1 2; 1 2 1; 1 3 1; 1 4 1; 1e20; "
    "-1e20; 0; 6.5; 0; 0; 0; 4; 0; 0; 2; 2 1; 4 2; 0; 0; 0; 0; 0; 0; 2; 1 first; 3 third; 1; "
    "1 capacity"
)
#: No constraints; the number of their names is omitted.
BINARY = lines("B; CBN; minimize; 2; 2; 1 1 2; 2 2 4; -1; 0; 0; 1e20; 0.5; 0; 0; 0; 0")
#: Example of the specification with a matrix variable and a quadratic cone.
SDP = lines(
    "# written by hand; VER; 1; ; OBJSENSE; MIN; PSDVAR; 1; 3; VAR; 3 1; F 3; CON; 5 2; L= 2; "
    "Q 3; OBJFCOORD; 5; 0 0 0 2.0; 0 1 0 1.0; 0 1 1 2.0; 0 2 1 1.0; 0 2 2 2.0; OBJACOORD; 1; "
    "1 1.0; FCOORD; 9; 0 0 0 0 1.0; 0 0 1 1 1.0; 0 0 2 2 1.0; 1 0 0 0 1.0; 1 0 0 1 1.0; "
    "1 0 2 0 1.0; 1 0 1 1 1.0; 1 0 2 1 1.0; 1 0 2 2 1.0; ACOORD; 6; 0 1 1.0; 1 0 1.0; 1 2 1.0; "
    "2 1 1.0; 3 0 1.0; 4 2 1.0; BCOORD; 2; 0 -1.0; 1 -0.5"
)
#: Every kind of cone, among the variables and among the constraints.
MIXED = lines(
    "VER; 4; OBJSENSE; MAX; PSDVAR; 2; 2; 1; VAR; 12 6; L+ 1; EXP 3; QR 3; L- 1; Q 2; F 2; "
    "PSDCON; 2; 2; 1; CON; 11 7; L= 1; L+ 1; L- 1; F 1; QR 3; EXP 3; Q 1; OBJFCOORD; 2; "
    "0 1 0 -1; 1 0 0 -2; OBJACOORD; 3; 0 -1; 1 -1.5; 11 0.25; OBJBCOORD; 3.5; FCOORD; 2; "
    "0 0 1 0 0.5; 5 1 0 0 2; ACOORD; 7; 0 0 1; 1 11 2; 2 3 -1; 4 4 1; 7 2 1; 8 0 1; 10 9 1; "
    "BCOORD; 3; 0 -1; 1 4; 9 2; HCOORD; 3; 0 10 0 0 1; 0 11 1 0 2; 1 11 0 0 -1; DCOORD; 2; "
    "0 1 1 3; 1 0 0 5"
)


def stripped(text, marks):
    """Return the fields of all lines that are not comments."""
    result = []
    for line in text.removeprefix("\ufeff").split("\n"):
        fields = []
        for field in line.split():
            if field[0] in marks:
                break
            fields.append(field)
        result += [fields] if fields else []
    return result


def naive_qplib(text):
    """Return the fields of the program in dense form, without any check."""
    lines = stripped(text, "#!%")
    one = lambda: lines.pop(0)[0]  # noqa: E731

    def vector(size, kind=float):
        result = np.full(size, float(one()))
        for _ in range(int(one())):
            place, entry = lines.pop(0)
            result[int(place) - 1] = float(entry)
        return result

    name, kind, sense, n = " ".join(lines.pop(0)), one(), one(), int(one())
    m = int(one()) if kind[2] == "L" else 0
    hessian, matrix = np.zeros((n, n)), np.zeros((m, n))
    if kind[0] != "L":
        for _ in range(int(one())):
            i, j, entry = lines.pop(0)
            hessian[int(i) - 1, int(j) - 1] = hessian[int(j) - 1, int(i) - 1] = float(entry)
    cost, offset = vector(n), float(one())
    if kind[2] == "L":
        for _ in range(int(one())):
            i, j, entry = lines.pop(0)
            matrix[int(i) - 1, int(j) - 1] = float(entry)
    infinity = float(one())

    def bound(size):
        values = vector(size)
        values[np.abs(values) >= infinity] *= np.inf
        return values

    low, high = (bound(m), bound(m)) if kind[2] == "L" else (np.zeros(0), np.zeros(0))
    if kind[1] == "B":
        lower, upper, types = np.zeros(n), np.ones(n), np.full(n, 2)
    else:
        lower, upper = bound(n), bound(n)
        types = vector(n) if kind[1] in "MG" else np.full(n, int(kind[1] == "I"))
        lower[types == 2], upper[types == 2] = 0, 1
    sign = {"minimize": 1, "maximize": -1}[sense.lower()]
    return {
        "name": name, "maximise": sign < 0, "offset": sign * offset, "cost": sign * cost, "matrix": matrix,
        "row_lower": low, "row_upper": high, "column_lower": lower, "column_upper": upper,
        "integral": types > 0, "hessian": sign * hessian,
    }  # fmt: skip


def fields_of(program):
    """Return the fields of a program in dense form."""
    names = ("maximise", "offset", "cost", "row_lower", "row_upper", "column_lower", "column_upper")
    n = program.size
    integral = program.integral if program.integral is not None else np.zeros(n, bool)
    hessian = getattr(program, "hessian", None)
    return {
        "name": program.name, **{name: getattr(program, name) for name in names},
        "matrix": program.matrix.toarray(), "integral": integral,
        "hessian": np.zeros((n, n)) if hessian is None else hessian.toarray(),
    }  # fmt: skip


def naive_cbf(text):
    """Return the sections as lists of numbers, without any check."""
    lines = stripped(text, "#")
    result = {}
    while lines:
        key = " ".join(lines.pop(0))
        if key in ("VER", "OBJSENSE", "OBJBCOORD"):
            result[key] = lines.pop(0)[0]
        else:
            count = int(lines.pop(0)[-1])
            result[key], lines = lines[:count], lines[count:]
    return result


def numbers(sections, key):
    for *index, entry in sections.get(key, ()):
        yield (*map(int, index), float(entry))


def rows_of(sections, x, matrices):
    """Return the objective, the distances from linear bounds, and the cones in the order of the reader."""
    g = np.zeros(sum(int(d) for _, d in sections.get("CON", ())))
    objective = float(sections.get("OBJBCOORD", 0))
    orders = [int(line[0]) for line in sections.get("PSDCON", ())]
    blocks = [np.zeros((d, d)) for d in orders]

    def symmetric(matrix, r, c, entry):
        matrix[r, c] += entry
        if r != c:
            matrix[c, r] += entry

    for j, entry in numbers(sections, "OBJACOORD"):
        objective += entry * x[j]
    for j, r, c, entry in numbers(sections, "OBJFCOORD"):
        objective += entry * (matrices[j][r, c] + (matrices[j][c, r] if r != c else 0))
    for i, j, entry in numbers(sections, "ACOORD"):
        g[i] += entry * x[j]
    for i, entry in numbers(sections, "BCOORD"):
        g[i] += entry
    for i, j, r, c, entry in numbers(sections, "FCOORD"):
        g[i] += entry * (matrices[j][r, c] + (matrices[j][c, r] if r != c else 0))
    for i, j, r, c, entry in numbers(sections, "HCOORD"):
        symmetric(blocks[i], r, c, entry * x[j])
    for i, r, c, entry in numbers(sections, "DCOORD"):
        symmetric(blocks[i], r, c, entry)
    linear, cones = [], []

    def scalars(section, vector):
        start = 0
        for kind, d in sections.get(section, ()):
            part = vector[start : start + int(d)]
            start += int(d)
            if kind[0] in "FL":
                linear.extend((kind, entry) for entry in part)
            elif kind == "EXP":
                cones.extend([part[2], part[1], part[0]])
            elif kind == "QR":
                both = (part[0] + part[1]) / np.sqrt(2), (part[0] - part[1]) / np.sqrt(2)
                cones.extend([*both, *part[2:]])
            else:
                cones.extend(part)

    def semidefinite(group):
        for matrix in group:
            for r in range(len(matrix)):
                for c in range(r + 1):
                    cones.append(matrix[r, c] * (1 if r == c else np.sqrt(2)))

    scalars("VAR", x)
    semidefinite(matrices)
    scalars("CON", g)
    semidefinite(blocks)
    return objective, linear, cones


@np.errstate(all="ignore")
def assert_same_cbf(program, text):
    """Compare a program with the file's definition at random points."""
    sections = naive_cbf(text)
    scalars = sum(int(d) for _, d in sections.get("VAR", ()))
    orders = [int(line[0]) for line in sections.get("PSDVAR", ())]
    rng = np.random.default_rng(0)
    assert program.maximise == (sections["OBJSENSE"] == "MAX")
    integral = getattr(program, "integral", np.zeros(program.size, bool))
    assert (
        sorted(int(line[0]) for line in sections.get("INT", ()))
        == np.flatnonzero(integral).tolist()
    )
    for _ in range(2):
        x = rng.standard_normal(scalars)
        matrices = [rng.standard_normal((d, d)) for d in orders]
        matrices = [matrix + matrix.T for matrix in matrices]
        point = np.array(
            [*x, *(m[r, c] for m in matrices for r in range(len(m)) for c in range(r + 1))]
        )
        assert point.size == program.size
        objective, linear, cones = rows_of(sections, x, matrices)
        sign = -1 if program.maximise else 1
        with np.errstate(over="ignore", invalid="ignore"):
            assert same(sign * program.objective(point), objective)
            in_cone = program.cone_rows(point) if cones else []
            assert len(in_cone) == len(cones)
            assert same(in_cone, cones)
            body = program.matrix @ point
            kinds = iter(linear)
            taken = [kind for kind, d in sections.get("VAR", ()) for _ in range(int(d))]
            for column, kind in enumerate(taken):
                if kind[0] in "FL":
                    assert next(kinds)[0] == kind
                low, high = program.column_lower[column], program.column_upper[column]
                assert low == (0 if kind in ("L+", "L=") else -np.inf)
                assert high == (0 if kind in ("L-", "L=") else np.inf)
            assert np.isinf(program.column_lower[scalars:]).all()
            remaining = list(kinds)
            assert len(remaining) == program.row_count
            for row, (kind, entry) in enumerate(remaining):
                low, high = program.row_lower[row], program.row_upper[row]
                assert same(body[row] - low, entry) if kind in ("L+", "L=") else low == -np.inf
                assert same(body[row] - high, entry) if kind in ("L-", "L=") else high == np.inf


def same(left, right):
    scale = np.max(np.abs(right), initial=1.0)
    return np.allclose(left, right, rtol=1e-9, atol=1e-9 * scale, equal_nan=True)


def assert_same_qplib(program, text):
    expected = naive_qplib(text)
    for name, found in fields_of(program).items():
        np.testing.assert_array_equal(found, expected[name], err_msg=name)
