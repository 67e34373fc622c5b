"""Files and functions are small enough to be read at once; parameters are few enough to know."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parent.parent / "bfrt"
SOURCES = sorted(
    path.relative_to(ROOT) for path in ROOT.rglob("*") if path.suffix in (".py", ".pyx", ".pxd")
)

MOST_LINES = 400
MOST_LINES_OF_A_FUNCTION = 60
MOST_PARAMETERS = 6

#: Longer files, and why.
LONG = {
    "scene.py": "the public class: most of it is docstrings",
    "sharded.py": "a public class: most of it is docstrings",
    "formats/_nff.pyx": "one parser, of one class",
}

#: What callers use has a parameter for each setting, in a line of its own, which does not count.
PUBLIC = {
    "scene.py", "sharded.py", "conversion/convert.py", "settings.py", "store/writer.py",
    "terrain/viewshed.py",
}  # fmt: skip

DEFINITION = re.compile(r"^( *)(?:cdef|cpdef|def)\b[^=\n]*?(\w+)\s*\(")
NO_FUNCTION = ("cdef struct", "cdef packed", "cdef class", "cdef enum", "cdef extern", "cdef union")
DOCSTRING = re.compile(r'\s*""".*?"""', re.DOTALL)


class Function(NamedTuple):
    name: str
    parameters: int
    lines: int


def of_python(text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            given = node.args
            own = [a for a in (*given.posonlyargs, *given.args) if a.arg not in ("self", "cls")]
            extra = (given.vararg is not None) + (given.kwarg is not None)
            doc = node.body[0] if ast.get_docstring(node) else None
            lines = node.end_lineno - node.lineno + 1
            lines -= doc.end_lineno - doc.lineno + 1 if doc else 0
            yield Function(node.name, len(own) + len(given.kwonlyargs) + extra, lines)


def of_cython(text):
    lines = text.split("\n")
    for number, line in enumerate(lines):
        match = DEFINITION.match(line)
        if not match or line.lstrip().startswith(NO_FUNCTION):
            continue
        rest = "\n".join(lines[number:])
        begin = rest.index("(", match.start(2))
        end = closing(rest, begin)
        head = rest[end:].split("\n")[0].rstrip()
        if head.endswith(":"):
            first = number + rest[:end].count("\n") + 1
            body = body_of(lines[first:], len(match[1]))
            yield Function(match[2], parameters(rest[begin + 1 : end]), first - number + body)


def closing(text, begin):
    """Where the bracket closes that opens at `begin`."""
    depth = 0
    for at in range(begin, len(text)):
        depth += (text[at] in "([{") - (text[at] in ")]}")
        if depth == 0:
            return at
    raise ValueError(text[begin : begin + 80])


def parameters(text):
    depth, names = 0, [""]
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            names.append("")
        else:
            names[-1] += letter
    return sum(name.strip() not in ("", "self", "cls", "*", "/") for name in names)


def body_of(lines, indent):
    """Lines of a body that is indented more, without its docstring."""
    own = []
    for line in lines:
        if line.strip() and len(line) - len(line.lstrip()) <= indent:
            break
        own.append(line)
    text = "\n".join(own).rstrip()
    return DOCSTRING.sub("", text, count=1).count("\n")


def functions(source):
    text = (ROOT / source).read_text()
    return of_python(text) if source.suffix == ".py" else of_cython(text)


@pytest.mark.parametrize("source", SOURCES, ids=str)
def test_files_and_functions_are_small(source):
    lines = (ROOT / source).read_text().count("\n")
    assert (lines > MOST_LINES) == (str(source) in LONG)
    for function in functions(source):
        settings = function.parameters if str(source) in PUBLIC else 0
        assert function.lines - settings <= MOST_LINES_OF_A_FUNCTION, function
        if not settings:
            assert function.parameters <= MOST_PARAMETERS, function


def test_few_files_are_long():
    assert len(LONG) <= 3


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("def f(a, b=(1, 2), *, c):\n    return a\n", Function("f", 3, 2)),
        ('cdef inline int g(\n    int a, int b\n) noexcept:\n    """x\n\n    y"""\n    a\n    b\n',
         Function("g", 2, 4)),
        ("cdef class C:\n    def h(self, a):\n        pass\n\n    x = 1\n", Function("h", 1, 1)),
    ],
)  # fmt: skip
def test_functions_are_counted(text, expected):
    found = list(of_cython(text))
    assert [(f.name, f.parameters) for f in found] == [(expected.name, expected.parameters)]
    assert abs(found[0].lines - expected.lines) <= 1
