"""The equations on a problem's page name code that exists."""

import pkgutil
import re
from pathlib import Path

import pytest

PAGES = sorted((Path(__file__).resolve().parents[2] / "docs" / "problems").glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_equations_name_the_code_that_writes_them(page):
    targets = re.findall(r"^ *```\{crosstrack-equation\} (.*)$", page.read_text("utf-8"), re.M)
    assert targets
    for target in targets:
        assert re.fullmatch(r"crosstrack\.[\w.]+:[\w.]+", target)
        pkgutil.resolve_name(target)
