"""Readers of programs in files, and in models of libraries that write such files."""

#: Functions that return the program in a file, by suffix; each may be followed by ``.gz``.
FILES = {
    ".cbf": ".cbf:read_cbf",
    ".lp": ".highs_files:read_lp",
    ".mat": ".array_files:read_mat",
    ".mps": ".highs_files:read_mps",
    ".nl": ".nl_file:read_nl",
    ".npz": ".array_files:read_npz",
    ".qplib": ".qplib:read_qplib",
}

#: Formats of plans for other software.
EXPORTS = {"csv": ".exports:CSV", "sol": ".exports:SOL"}

#: Functions that return the program of a library's model, by the library that defines its type.
OBJECTS = {
    "gurobipy": ".libraries:program_of_gurobi",
    "linopy": ".libraries:program_of_linopy",
    "ortools": ".libraries:program_of_mathopt",
    "pulp": ".libraries:program_of_pulp",
    "pyomo": ".libraries:program_of_pyomo",
}
