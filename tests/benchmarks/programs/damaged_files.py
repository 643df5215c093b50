"""Read damaged MPS, LP and NL files, and compare every accepted one with other readers.

Each mutation of a valid file must end in an `InvalidData` or in a program. Two readers of MPS and LP
(Gurobi and SCIP) and an evaluator of NL read every accepted file, too; the programs must be equal.
Usage::

    python tests/benchmarks/programs/damaged_files.py          # 700 mutations per format
    python tests/benchmarks/programs/damaged_files.py lp 5000
"""

from __future__ import annotations

import multiprocessing
import random
import resource
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / "programs")]

from program_texts import LP, MPS, NL, QUADRATIC_LP, QUADRATIC_MPS, random_nl  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.errors import CrosstrackError, InvalidData  # noqa: E402
from crosstrack.instances.programs import highs_files, nl_file  # noqa: E402

DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "programs" / "mps"
#: Public files of at most this many bytes are mutated.
LARGEST = 30_000
NUMBERS = [
    "1e400", "-1e400", "1e30", "-1e30", "1e20", "1e19", "1e-400", "1e-11", "12345678901234567890", "nan",
    "inf", "-inf", "1.0abc", "0x10", "1D3", "1,5", "1e", "1e+", ".", "-", "+", "1..2", "1e5e5", "0", "-0",
    "-7", "5", "3.5", "\u00bd",
]  # fmt: skip
WORDS = [
    "st", "end", "free", "bounds", "max", "binary", "sos", "inf", "[", "]", "/", "2", ":", "<=", ">=",
    "RHS", "MAX", "NAME", "'MARKER'", "N", "E", "UP", "BV", "MI", "SC", "ENDATA", "*", "$", "=", "v0", "o2",
    "o54", "n1", "C0", "J0", "O0", "b", "r", "k1", "S0", "V3", "\\", ";", "#", "<",
]  # fmt: skip


def mutated(text: str, draw: random.Random) -> bytes:
    """Return the text with one to three faults."""
    raw = text.encode()
    for _ in range(draw.choice((1, 1, 1, 2, 3))):
        raw = _fault(raw, draw)
    return raw


def _fault(raw: bytes, draw: random.Random) -> bytes:
    kind = draw.randrange(14)
    if kind == 0:  # another byte
        at = draw.randrange(max(len(raw), 1))
        return raw[:at] + bytes([draw.randrange(256)]) + raw[at + 1 :]
    if kind == 1:
        at = draw.randrange(len(raw) + 1)
        return raw[:at] + draw.choice(b" \n\t\r0x-.e1:;".decode()).encode() + raw[at:]
    if kind == 2:
        return raw[: draw.randrange(len(raw) + 1)]
    lines = raw.split(b"\n")
    at, other = draw.randrange(len(lines)), draw.randrange(len(lines))
    if kind == 3:
        del lines[at]
    elif kind == 4:
        lines.insert(other, lines[at])
    elif kind == 5:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 6:
        lines[at : at + 2] = [b" ".join(lines[at : at + 2])]
    elif kind == 7:
        del lines[min(at, other) : max(at, other)][: draw.randint(1, 4)]
    else:
        tokens = lines[at].split(b" ")
        foreign = lines[other].split()
        k = draw.randrange(len(tokens))
        if kind == 8:
            tokens[k] = draw.choice(NUMBERS).encode()
        elif kind == 9:
            tokens[k] = draw.choice(WORDS).encode()
        elif kind == 10 and foreign:
            tokens[k] = draw.choice(foreign)
        elif kind == 11:
            del tokens[k]
        elif kind == 12:
            tokens.insert(draw.randrange(len(tokens) + 1), tokens[k])
        else:
            tokens[k] = draw.choice((tokens[k].upper(), tokens[k].lower(), tokens[k] + b"\n"))
        lines[at] = b" ".join(tokens)
    return b"\n".join(lines)


def texts(suffix: str) -> list[str]:
    """Return the valid texts of a format."""
    if suffix == "nl":
        return [NL, *map(random_nl, range(20))]
    public = [p for p in sorted(DATA.glob("*.mps")) if p.stat().st_size <= LARGEST]
    if suffix == "mps":
        return [MPS, QUADRATIC_MPS] * 6 + [p.read_text() for p in public]
    exported = [ct.load(p).to_lp() for p in public[:6] if hasattr(ct.load(p), "to_lp")]
    return [LP, QUADRATIC_LP] * 6 + exported


def examine(path: Path, suffix: str) -> tuple[str, str]:
    """Return the outcome for one file, and a detail."""
    import second_readers

    stage = "check"

    def in_process(reader: str, path: Path, raw: bytes, suffix: str) -> tuple[Any, Any]:
        nonlocal stage
        stage = "library"
        copy = path.with_name("copy" + suffix)
        copy.write_bytes(raw)
        read = (nl_file if reader == "nl" else highs_files).arrays_of_file
        try:
            return read(copy)
        except (InvalidData, RuntimeError, ValueError, MemoryError, KeyError) as error:
            raise InvalidData(f"{path}: {error}") from None

    highs_files.read_apart = nl_file.read_apart = in_process  # type: ignore[assignment]
    try:
        program = ct.load(path)
    except CrosstrackError as error:
        named = str(path) in str(error)
        return f"refused by the {stage}" if named else "refused without the file", str(error)
    except Exception as error:  # every other exception is a fault of the package
        return "traceback", f"{type(error).__name__}: {error}"
    if suffix == "nl":
        try:
            difference = second_readers.NlReader(path).differs(program)
        except (ValueError, StopIteration, KeyError, TypeError, OverflowError, IndexError) as error:
            return "second reader refuses", repr(error)
        return ("differs", difference) if difference else ("equal", "")
    mine, outcomes = second_readers.of_program(program), []
    for read in (second_readers.of_gurobi, second_readers.of_scip):
        try:
            other = read(path)
        except ValueError as error:
            outcomes.append(f"{read.__name__} refuses: {error}")
            continue
        parts = [key for key in mine if mine[key] != other[key]]
        if parts:
            detail = "; ".join(f"{key}: {_difference(mine[key], other[key])}" for key in parts)
            return f"differs from {read.__name__[3:]}", detail[:600]
        outcomes.append("equal")
    return ("equal", "") if "equal" in outcomes else ("both readers refuse", "; ".join(outcomes))


def _difference(mine: Any, other: Any) -> str:
    if isinstance(mine, dict):
        return str(
            [
                (k, mine.get(k), other.get(k))
                for k in {**mine, **other}
                if mine.get(k) != other.get(k)
            ]
        )
    if isinstance(mine, list):
        return f"{[x for x in mine if x not in other]} {[x for x in other if x not in mine]}"
    return f"{mine} {other}"


def work(connection: Any) -> None:
    """Examine the files that arrive, with limited memory."""
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    while True:
        path, suffix = connection.recv()
        outcome = examine(path, suffix)
        connection.send((*outcome, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))


def main() -> None:
    """Mutate, read, and print the counts and all disagreements."""
    formats = [name for name in sys.argv[1:] if not name.isdigit()] or ["mps", "lp", "nl"]
    count = next((int(word) for word in sys.argv[1:] if word.isdigit()), 700)
    context = multiprocessing.get_context("fork")
    for suffix in formats:
        sources, counts = texts(suffix), Counter[str]()
        worker, connection, started, largest = None, None, time.monotonic(), 0.0
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(count):
                draw = random.Random(f"{suffix} {seed}")
                path = Path(folder, f"damaged.{suffix}")
                path.write_bytes(mutated(draw.choice(sources), draw))
                if worker is None or not worker.is_alive():
                    connection, end = context.Pipe()
                    worker = context.Process(target=work, args=(end,), daemon=True)
                    worker.start()
                    end.close()
                connection.send((path, suffix))
                try:
                    alive = connection.poll(60)
                    outcome, detail, memory = connection.recv() if alive else ("timeout", "", 0.0)
                except EOFError:
                    outcome, detail, memory = "crash", "", 0.0
                if outcome in ("crash", "timeout"):
                    worker.kill()
                    worker.join()
                largest = max(largest, memory)
                counts[outcome] += 1
                if outcome not in ("equal", "refused by the check", "refused by the library"):
                    print(f"{suffix} {seed}: {outcome}: {detail}", flush=True)
        if worker is not None:
            worker.kill()
        print(
            f"{suffix}: {dict(counts.most_common())}, {largest:.0f} MiB, {time.monotonic() - started:.0f} s"
        )


if __name__ == "__main__":
    main()
