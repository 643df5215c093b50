"""Run the conformance suite over every installed backend of programs, and write what it found.

::

    python tests/benchmarks/conformance.py docs/campaign/conformance.json
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import crosstrack as ct
from crosstrack.solvers import find_backend
from crosstrack.solvers.conformance import cases_for, run_suite
from crosstrack.solvers.processes.environment import _machine


def main(path: str) -> None:
    """Write the suite's matrix in numbers to `path`."""
    states = [
        state
        for state in ct.backends()
        if state.state == "installed" and not state.problem and cases_for(find_backend(state.name))
    ]
    matrix = run_suite([state.name for state in states])
    found = []
    for state in states:
        own = [one for one in matrix.results if one.backend == state.name]
        counts = Counter(str(one.status) for one in own)
        found.append(
            {
                "name": state.name, "version": state.version, "features": list(state.features),
                "passed": counts["pass"], "unsupported": counts["unsupported"],
                "failed": counts["fail"],
                "failures": [f"{one.case}: {one.reason}" for one in own if str(one.status) == "fail"],
            }
        )  # fmt: skip
    machine = _machine()
    words = (
        f"Run on {datetime.now(UTC):%Y-%m-%d} on {machine['processors']} processors ({machine['processor']}, "
        f"{machine['memory']} GiB), crosstrack {ct.__version__}, Python {machine['python']}: {len(found)} backends, "
        f"{sum(one['passed'] for one in found)} cases passed, "
        f"{sum(one['failed'] for one in found)} failed. A feature that a backend does not declare makes "
        "its cases unsupported."
    )
    Path(path).write_text(
        json.dumps({"words": words, "processor": machine["processor"], "backends": found}, indent=1)
        + "\n"
    )


if __name__ == "__main__":
    main(sys.argv[1])
