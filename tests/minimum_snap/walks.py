"""Paths to draw: random waypoints, boxes and half-spaces around them, and trajectories."""

import itertools

import numpy as np
import scipy.sparse as sp
from pictures import panels
from scipy.interpolate import PPoly, make_interp_spline

from crosstrack.models import MinimumSnap, Trajectory


def spline(model):
    """Return the minimum-snap trajectory from rest to rest, as SciPy finds it."""
    t, w = model.times, model.waypoints
    rest = [(j, np.zeros(w.shape[1])) for j in (1, 2, 3)]
    found = make_interp_spline(t, w, k=7, bc_type=(rest, rest))
    pieces = [PPoly.from_spline((found.t, np.ascontiguousarray(c), 7)) for c in found.c.T]
    keep = np.flatnonzero(np.diff(pieces[0].x) > 0)
    c = np.stack([piece.c[:, keep] for piece in pieces], axis=2)
    return Trajectory.from_ppoly(PPoly(c, np.append(pieces[0].x[keep], pieces[0].x[-1])))


def solved(model):
    """Return a solution of the model's own program, which holds its bounds at some instants."""
    import piqp

    formulation = model.formulate("legendre")
    program = formulation.program
    lower, upper = program.row_lower, program.row_upper
    equal = lower == upper
    matrix = sp.csc_matrix(program.matrix)
    solver = piqp.SparseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-9
    solver.setup(
        sp.csc_matrix(program.hessian), program.cost, matrix[equal], lower[equal],
        matrix[~equal], np.maximum(lower[~equal], -1e30), np.minimum(upper[~equal], 1e30),
    )  # fmt: skip
    solver.solve()
    return formulation.decode(np.array(solver.result.x))


def walk(segments, dimensions, seed=1, **more):
    steps = np.random.default_rng(seed).normal(size=(segments + 1, dimensions))
    return MinimumSnap(
        np.cumsum(steps, axis=0), np.linspace(0, 1.2 * segments, segments + 1), **more
    )


def boxes(model, by):
    before, after = model.waypoints[:-1], model.waypoints[1:]
    return {
        "corridor_lower": np.minimum(before, after) - by,
        "corridor_upper": np.maximum(before, after) + by,
    }


def strips(model, by):
    """Return half-spaces on both sides of, before and behind every leg."""
    rows = []
    for k, (here, there) in enumerate(itertools.pairwise(model.waypoints)):
        along = (there - here) / np.linalg.norm(there - here)
        across = np.linalg.svd(along[None])[2][1:]
        for normal in (*across, *-across):
            rows.append((k, normal, normal @ here + by))
        rows += [(k, along, along @ there + by), (k, -along, -along @ here + by)]
    segments, normals, offsets = zip(*rows, strict=True)
    return {
        "polytope_segments": segments, "polytope_normals": normals, "polytope_offsets": offsets,
    }  # fmt: skip


def path(figure):
    """Return the axes of the path."""
    return figure.axes[0]


def derivatives(figure):
    """Return the axes of the derivatives by their name."""
    found = panels(figure)
    order = ("position", "velocity", "acceleration", "jerk", "snap", "crackle")
    return {word: found[word] for word in order if word in found}
