"""Self-contained HTML pages: their template, style sheet and script, which a policy allows by hash."""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from string import Template

__all__ = ["fill_page", "resource"]


def resource(package: str, name: str) -> str:
    """Return the text of a file of a package."""
    return files(package).joinpath(name).read_text("utf-8")


def fill_page(template: str, style: str, script: str, **fields: str) -> str:
    """Return a page that runs this style sheet and script only, and requests nothing.

    Parameters
    ----------
    template : str
        Page with the fields ``$style``, ``$script``, ``$style_hash``, ``$script_hash`` and those of `fields`.
    style, script : str
        Texts of the style sheet and of the script.
    **fields : str
        HTML of the other fields, with text from outside escaped.
    """
    hashes = {"style_hash": _hash(style), "script_hash": _hash(script)}
    return Template(template).substitute(style=style, script=script, **hashes, **fields)


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return "sha256-" + base64.b64encode(digest).decode("ascii")
