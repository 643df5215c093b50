"""Options of the benchmarks, and the table at the end of their run.

``pytest tests`` skips the benchmarks: they run only if this folder is named.
"""

from __future__ import annotations

import pytest
from benchmarks.ledger import Ledger

from crosstrack.jit import compile_always

_LEDGER = pytest.StashKey[Ledger]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--peer-limit",
        type=float,
        default=60.0,
        metavar="SECONDS",
        help="time limit of every solver but label-setting (default 60)",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_LEDGER] = Ledger()
    compile_always()  # loops are timed as they run once a process has much to do


@pytest.fixture(scope="session")
def ledger(pytestconfig: pytest.Config) -> Ledger:
    """Where measurements are entered."""
    return pytestconfig.stash[_LEDGER]


@pytest.fixture(scope="session")
def limit(pytestconfig: pytest.Config) -> float:
    """Seconds that a peer may take."""
    return pytestconfig.getoption("--peer-limit")


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    found = config.stash[_LEDGER]
    if found.titles or found.starts:
        terminalreporter.section("ours and their peers")
        for line in found.lines():
            terminalreporter.write_line(line)
