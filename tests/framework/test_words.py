"""Budgets for phrases that make docstrings, comments, messages and pages hard to read.

Each class has a pattern and the largest accepted number of hits per 1,000 lines of text, which is
what SciPy, NetworkX and CVXPY stay below.
"""

import re
from collections import Counter

import pytest

#: Class of phrases: budget per 1,000 lines, pattern, and an example that the pattern must find.
CLASSES = {
    "headless clause": (
        0.5,
        (r"(?:^|[.;:,(] ?)(?:[Ww]hat|[Ww]ho|[Ww]hoever|whatever) (?:is|was|are|were|has|have|had|does|do"
        r"|did|no|an?|the|it|of|comes|lies|needs|follows|holds|stands|ends|they|cannot|can|only|makes|asks"
        r"|remains|belongs|fails|failed|goes|gives|looks)\b"),
        "What is left of the budget.",
    ),
    "where for if": (
        2.0,
        (r"\b[Ww]here (?:it|there|they|that|nothing|none|nobody|all|no|some|each|one|an?|both|any|this"
        r"|these|its|asked|given|known|needed)\b"),
        "None where there is no limit",
    ),
    "negated noun": (
        3.0,
        (r"\bthere (?:is|are|was|were) (?:none|no|nothing|nobody)\b|\b(?:is|are) none\b"
        r"|\bis no (?:number|plan|limit|name|picture|option|part|path|more)\b"),
        "if there is no plan",
    ),
    "at the most": (0.3, r"\bat the (?:most|least|latest|earliest)\b", "four at the most"),
    "a for per": (
        0.5,
        (r"\b(?:one|two|three|rows?|entry|column|lines?|number|seed|process|values?|check|word|points?|path"
        r"|file|bytes|steps|samples|seconds|copies|page|folder|name) an? (?!(?:few|little|lot|bit|single"
        r"|given)\b)[a-z]+(?=[\s,.;:)]|$)"),
        "a row, one a segment",
    ),
    "people for code": (
        0.3,
        r"\b(?:nobody|somebody|whoever|stranger(?:s|'s)?|(?:for|by|to) who)\b",
        "nobody reads it",
    ),
    "speech for code": (
        0.5,
        (r"\b(?:is|are|was|were|be) (?:said|told|content|believed|granted)\b"
        r"|\bsays? (?:so|which|why|where|of)\b|\btells? (?:so|of|which|why|where)\b|\basks? of\b"),
        "the log says so",
    ),
    "archaic word": (
        1.5,
        (r"\b(?:anew|besides|thereof|therein|hence|wherein|lest|thus|mend(?:ed|s)?|better(?:s|ed)"
        r"|hitherto|hardly|scarcely|sought|bears|bore|borne|stead|amiss|likewise|in vain|to be had)\b"),
        "the plan is computed anew",
    ),
    "of which": (
        3.0,
        r"\b(?:of which|by which|in which|from which|such as (?:that|those)|and so (?:is|are|does|do))\b",
        "the set of which it is one",
    ),
    "lies in": (
        1.0,
        (r"\b(?:counts? as|stands? (?:for|on|in|beside|apart|under)|lies? (?:in|on|beside|below|under"
        r"|between)|goes? on|came of|comes? of|comes? out)\b"),
        "the search goes on",
    ),
}  # fmt: skip
#: Finds every hit of any class: most lines have none.
ANY = re.compile("|".join(f"(?:{pattern})" for _, pattern, _ in CLASSES.values()))
#: Places in code or mathematics, which are no prose.
CODE = re.compile(r"``[^`]*``|`[^`]*`|\$[^$]*\$|:[a-z:]+:`[^`]*`")

#: Strings, and comments as the second group. It finds the comments of `tokenize` in a tenth of the time.
STRINGS_AND_COMMENTS = re.compile(
    r"""("{3}|'{3})(?:\\.|.)*?\1|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|(#[^\n]*)""", re.S
)


#: A statement that raises, up to the last line that is indented further or closes a bracket.
RAISES = re.compile(r"^([ ]*)raise [^\n]*(?:\n\1[ )\]][^\n]*)*", re.M)
#: Code within a string of an exception.
FIELD = re.compile(r"\{[^{}]*\}")


def python_lines(text):
    """Yield the lines of docstrings, comments and messages of exceptions.

    `ast` finds the same in ten times the time: a docstring is a triple-quoted string that begins its line.
    """
    ends = [(found.start(), found.end()) for found in RAISES.finditer(text)]
    for found in STRINGS_AND_COMMENTS.finditer(text):
        if found[2]:
            yield found[2].lstrip("#: ")
            continue
        begin = found.start()
        while ends and ends[0][1] <= begin:
            ends.pop(0)
        if ends and ends[0][0] <= begin:
            yield from FIELD.split(found[0].strip("\"'"))
        elif found[1] and not text[text.rfind("\n", 0, begin) + 1 : begin].strip(" r"):
            yield from map(str.strip, found[0][3:-3].splitlines())


def page_lines(text):
    """Yield the lines of a page outside of code blocks."""
    for k, part in enumerate(re.split(r"^\s*(?:```|~~~).*$", text, flags=re.M)):
        if k % 2 == 0:
            yield from part.splitlines()


def count_hits(paths):
    """Return the number of lines of prose in files, and the hits per class."""
    lines, hits = 0, Counter()
    for path in paths:
        text = path.read_text("utf-8")
        for line in python_lines(text) if path.suffix == ".py" else page_lines(text):
            prose = CODE.sub("`x`", line).strip()
            if prose:
                lines += 1 + len(prose) // 110  # long lines of pages count for several
                if ANY.search(prose):
                    for name, (_, pattern, _) in CLASSES.items():
                        hits[name] += len(re.findall(pattern, prose))
    return lines, hits


def test_lines_are_docstrings_messages_and_comments():
    text = '''"""Page."""
def f(x):  # one
    """Return "x" # no comment."""
    if x == "\\"#":  #: two
        raise ValueError(f"x is {x} # three")
    return lambda: '#', """#"""
'''
    assert list(python_lines(text)) == [
        *("Page.", "one", 'Return "x" # no comment.', "two", "x is ", " # three"),
    ]


@pytest.mark.parametrize("name", CLASSES)
def test_each_pattern_finds_its_example(name):
    _, pattern, example = CLASSES[name]
    assert re.search(pattern, example)
    assert not re.search(pattern, "Return the upper bound on the tour length, in metres.")


def test_the_text_of_the_project_is_within_every_budget(own_files):
    lines, hits = count_hits(path for path in own_files if path.suffix in (".py", ".md"))
    over = {
        name: f"{1000 * hits[name] / lines:.1f} per 1,000 lines, at most {budget}"
        for name, (budget, _, _) in CLASSES.items()
        if hits[name] > budget * lines / 1000
    }
    assert not over
