"""Self-contained HTML pages: their template, style sheet and script, which a policy allows by hash."""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from string import Template

__all__ = ["fill_page", "resource"]

#: Page around the content of its body.
_PAGE = Template(
    """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" \
content="default-src 'none'; img-src data:; style-src '$style_hash'; script-src '$script_hash'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<link rel="icon" href="data:,">
<title>$title</title>
<style>$style</style>
</head>
<body>
$body<script>$script</script>
</body>
</html>
"""
)


def resource(package: str, name: str) -> str:
    """Return the text of a file of a package."""
    return files(package).joinpath(name).read_text("utf-8")


def fill_page(template: str, style: str, script: str, *, title: str, **fields: str) -> str:
    """Return a page that runs this style sheet and script only, and requests nothing.

    Parameters
    ----------
    template : str
        Content of the body with the fields ``$title`` and those of `fields`.
    style, script : str
        Texts of the style sheet and of the script.
    title : str
        Title of the page, as HTML.
    **fields : str
        HTML of the other fields, with text from outside escaped.
    """
    hashes = {"style_hash": _hash(style), "script_hash": _hash(script)}
    body = Template(template).substitute(title=title, **fields)
    return _PAGE.substitute(title=title, body=body, style=style, script=script, **hashes)


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return "sha256-" + base64.b64encode(digest).decode("ascii")
