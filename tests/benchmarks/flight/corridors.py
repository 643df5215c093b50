"""Corridors on random maps in three dimensions beside GCOPTER's: proofs, volumes and computing times.

Compiles the headers in ``../shared/peers/gcopter`` with g++ and Eigen in a temporary folder. Both methods get
the same paths. GCOPTER gets the centres of the blocked cubes at the surface, as in its own examples, and ours
gets the cubes, or the same points.

::

    python tests/benchmarks/flight/corridors.py [MAPS]
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "tests")]

from benchmarks.measured import write  # noqa: E402

from crosstrack.instances.flight import forest, noise_map  # noqa: E402
from crosstrack.models.flight import Corridor, corridor  # noqa: E402
from crosstrack.models.flight.corridors_inflation import inflate  # noqa: E402
from crosstrack.models.flight.corridors_obstacles import as_obstacles  # noqa: E402

PEER = ROOT.parent / "shared" / "peers" / "gcopter"
#: Size of the maps and the radius of the vehicle, m, and GCOPTER's lengths of segments and ranges, m.
SIZE, RADIUS, PROGRESS, RANGE = (25.0, 25.0, 5.0), 0.5, 7.0, 3.0
ENDS = np.array([[1.5, 1.5, 2.5], [23.5, 23.5, 2.5]])
#: The function of sfc_gen.hpp that plans paths needs OMPL: only the lines before and after it are compiled.
MAIN = """
#include "covers.hpp"
#include <ctime>
#include <iostream>
int main() {
  int n, m; double progress, range; Eigen::Vector3d low, high;
  std::cin >> n >> m >> progress >> range;
  for (int i = 0; i < 3; ++i) std::cin >> low(i) >> high(i);
  std::vector<Eigen::Vector3d> path(n), points(m);
  for (auto &p : path) std::cin >> p(0) >> p(1) >> p(2);
  for (auto &p : points) std::cin >> p(0) >> p(1) >> p(2);
  std::vector<Eigen::MatrixX4d> polytopes;
  std::clock_t begin = std::clock(); int runs = 0;
  do { sfc_gen::convexCover(path, points, low, high, progress, range, polytopes); ++runs;
  } while (std::clock() - begin < 0.05 * CLOCKS_PER_SEC);
  std::cout.precision(17);
  std::cout << double(std::clock() - begin) / CLOCKS_PER_SEC / runs << std::endl;
  for (auto &p : polytopes) std::cout << p.rows() << std::endl << p << std::endl;
}
"""


def compiled(folder: Path) -> Path | None:
    """Return the program of GCOPTER's corridors, or None with a printed reason."""
    if not PEER.is_dir() or shutil.which("g++") is None:
        print(f"GCOPTER is skipped: its headers in {PEER.name} or g++ are missing")
        return None
    lines = (PEER / "sfc_gen.hpp").read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if "template <typename Map>" in line)
    last = next(k for k, line in enumerate(lines) if "inline void convexCover" in line)
    kept = [line for line in lines[:first] + lines[last:] if "ompl" not in line]
    (folder / "covers.hpp").write_text("\n".join(kept))
    (folder / "main.cpp").write_text(MAIN)
    command = [
        "g++",
        "-O3",
        "-std=c++14",
        f"-I{PEER}",
        "-I/usr/include/eigen3",
        "main.cpp",
        "-o",
        "covers",
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        print("GCOPTER is skipped: g++ fails:", done.stderr.strip().splitlines()[0])
        return None
    return folder / "covers"


def peer_corridor(program: Path, path, points, low, high):
    """Return the seconds of CPU and the polytopes of GCOPTER."""
    numbers = [[len(path), len(points), PROGRESS, RANGE], np.column_stack([low, high]).ravel()]
    numbers += [path.ravel(), points.ravel()]
    text = " ".join(f"{value:.17g}" for part in numbers for value in part)
    lines = subprocess.run(
        [program], input=text, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    seconds, polytopes, k = float(lines[0]), [], 1
    while k < len(lines):
        count = int(lines[k])
        table = np.array([line.split() for line in lines[k + 1 : k + 1 + count]], float)
        length = np.linalg.norm(table[:, :3], axis=1)
        polytopes.append((table[:, :3] / length[:, None], -table[:, 3] / length))
        k += 1 + count
    return seconds, polytopes


def planned(map_):
    """Return a path between the ends, at least one cube away from the blocked ones, or None."""
    from skimage.graph import route_through_array

    wide = map_.inflated(1.01 * map_.cell)
    first, last = (tuple(wide.cells_of(end)) for end in ENDS)
    if wide.blocked[first] or wide.blocked[last]:
        return None
    try:
        cells, _ = route_through_array(
            np.where(wide.blocked, -1.0, 1.0), first, last, geometric=True
        )
    except ValueError:  # without a path
        return None
    # Shortcuts between every fourth cell.
    places = wide.centres([*cells[:-1:4], cells[-1]])
    if not all(visible(wide, a, b) for a, b in pairwise(places)):
        places = wide.centres(cells)
    path, k = [0], 0
    while k < len(places) - 1:
        ahead = range(len(places) - 1, k, -1)
        k = next(j for j in ahead if j == k + 1 or visible(wide, places[k], places[j]))
        path.append(k)
    return places[path]


def visible(map_, a, b):
    steps = int(np.linalg.norm(b - a) / (0.2 * map_.cell)) + 2
    points = a + np.linspace(0, 1, steps)[:, None] * (b - a)
    return bool(map_.holds(map_.cells_of(points)).all())


def surface(map_):
    """Return the centres of the blocked cubes with a free neighbour, m."""
    from scipy.ndimage import binary_erosion

    inner = binary_erosion(map_.blocked, border_value=1)
    return map_.centres(np.argwhere(map_.blocked & ~inner))


def shape(normals, offsets):
    """Return a corridor of one polytope, for its volume."""
    axes = np.eye(3)
    low, high = np.full(3, -1e3), np.full(3, 1e3)
    normals = np.concatenate([normals, axes, -axes])
    offsets = np.r_[offsets, high, -low]
    return Corridor(
        np.zeros((1, 3)), [[0, 0]], np.zeros(len(offsets), int), normals, offsets, np.empty((0, 4))
    )


def pieces(path):
    """Yield GCOPTER's segments: at most PROGRESS long."""
    b, i = path[0], 1
    while i < len(path):
        a, step = b, path[i] - b
        if np.linalg.norm(step) > PROGRESS:
            b = a + step * (PROGRESS / np.linalg.norm(step))
        else:
            b, i = path[i], i + 1
        yield np.stack([a, b])


def main() -> None:
    maps = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        program = compiled(Path(folder))
        ratios, done, seed = [], 0, 0
        while done < maps:
            make = (forest, noise_map)[seed % 2]
            options = {"pillars": 30, "rings": 8} if make is forest else {}
            map_ = make(seed, SIZE, keep=ENDS, **options).inflated(RADIUS)
            seed += 1
            path = planned(map_)
            if path is None:
                continue
            done += 1
            cloud = surface(map_)
            low, high = np.zeros(3), np.array(SIZE)
            for method, name, solids in (
                ("firi", "cubes", map_), ("one-pass", "cubes", map_), ("firi", "points", cloud)
            ):  # fmt: skip
                begin = time.process_time()
                result = corridor(solids, path, bounds=[*low, *high], reach=13.0, method=method)
                spent = time.process_time() - begin
                begin = time.process_time()
                proven = result.verify(solids)
                checked = time.process_time() - begin
                if not proven.ok:
                    print("seed", seed - 1, method, name, proven)
                rows.setdefault(f"{method}, {name}", []).append(
                    (proven.ok, len(result), result.volumes.sum(), spent, checked)
                )
            if program is None:
                continue
            spent, polytopes = peer_corridor(program, path, cloud, low, high)
            parts = [shape(*part) for part in polytopes]
            into = max(part.verify(map_).checks[0].worst for part in parts)
            points_in = max((cloud @ n.T - b).max(axis=1).min() < -1e-9 for n, b in polytopes)
            volume = sum(float(part.volumes[0]) for part in parts)
            rows.setdefault("GCOPTER, cubes", []).append(
                (into == 0, len(parts), volume, spent, into)
            )
            rows.setdefault("GCOPTER, points", []).append(
                (not points_in, len(parts), volume, spent, into)
            )
            # The same segments and boxes: the volume of each polytope is comparable.
            ours = [[], []]
            for kind, solids in enumerate((map_, cloud)):
                known = as_obstacles(solids, 3)
                for seeds in pieces(path):
                    box_low = np.maximum(seeds.min(axis=0) - RANGE, low)
                    box_high = np.minimum(seeds.max(axis=0) + RANGE, high)
                    part = inflate(known.within(box_low, box_high), 0.0, seeds, box_low, box_high)
                    ours[kind].append(float(shape(part.normals, part.offsets).volumes[0]))
            if len(parts) == len(ours[0]):  # without GCOPTER's additional polytopes
                ratios += [
                    (a / float(p.volumes[0]), b / float(p.volumes[0]))
                    for a, b, p in zip(*ours, parts, strict=True)
                ]
            if done % 5 == 0:
                print(done, "maps", flush=True)
    table = []
    for name, values in rows.items():
        data = np.array(values, float)
        table.append(
            (
                name,
                f"{int(data[:, 0].sum())} of {len(data)}",
                *np.median(data[:, 1:4], axis=0),
                data[:, 3].max(),
            )
        )
        print(
            "{:22s} {:>12s} {:6.1f} {:10.1f} m³ {:8.4f} s {:8.4f} s".format(*table[-1]),
            np.median(data[:, 4]),
            data[:, 4].max(),
        )
    said = (
        f"{maps} maps of 25 m × 25 m × 5 m in cubes of 0.25 m: forests and noise in turns, seeds 0 to {seed - 1}, if "
        "they have a path. GCOPTER gets the points in both rows. Medians, and the greatest CPU time."
    )
    if ratios:
        median = np.median(ratios, axis=0)
        print(
            "volume beside GCOPTER, same segments and boxes: cubes, points",
            median,
            np.mean(ratios, axis=0),
            len(ratios),
        )
        said += (
            " With GCOPTER's segments and boxes, the median volume of a polytope relative to GCOPTER's is "
            f"{median[0]:.2f} for cubes and {median[1]:.2f} for points."
        )
    columns = {"method, obstacles": "", "free": "", "polytopes": ".0f", "volume (m³)": ".0f",
               "CPU (s)": ".3f", "CPU, greatest (s)": ".3f"}  # fmt: skip
    if maps >= 100 and program is not None:
        write("flight", "corridors", __file__, columns, table, ("numpy", "scipy", "clarabel"), said)


if __name__ == "__main__":
    main()
