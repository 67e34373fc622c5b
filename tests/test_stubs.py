"""Stubs say what compiled modules have; and a constant has its value in one place."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import pytest
from declared import STRINGS, declared, lines_of, stubbed

ROOT = Path(__file__).parent.parent / "bfrt"
MODULES = sorted(path.relative_to(ROOT).with_suffix("") for path in ROOT.rglob("*.pyx"))


def with_constructors(names):
    """A class that says nothing of its making takes no arguments."""
    classes = [name for name, what in names.items() if what is None and name[0].isupper()]
    made = {f"{name}.init": [] for name in classes if "." not in name and not name.isupper()}
    return {**made, **names}


def text_of(module, suffix):
    path = (ROOT / module).with_suffix(suffix)
    return path.read_text() if path.exists() else ""


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_a_stub_says_what_its_module_has(module):
    has = declared(text_of(module, ".pyx"), text_of(module, ".pxd"))
    says = stubbed(text_of(module, ".pyi"))
    assert says, f"{module}.pyi is missing, or empty"
    assert with_constructors(says) == with_constructors(has)


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_the_text_is_read_as_the_compiler_reads_it(module):
    """What the built module has is what its text was found to declare."""
    built = import_module(".".join(("bfrt", *module.parts)))
    found = declared(text_of(module, ".pyx"), text_of(module, ".pxd"))
    for name in found:
        owner, _, member = name.partition(".")
        assert hasattr(built, owner)
        assert member in ("", "init") or hasattr(getattr(built, owner), member)
    own = {
        name
        for name, value in vars(built).items()
        if getattr(value, "__module__", None) == built.__name__ and not name.startswith("_")
    }
    assert own <= found.keys()


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("def f(const int[:, ::1] a, b, C c not None, int d=1, e=None):\n    pass\n",
         {"f": [("a", False), ("b", False), ("c", False), ("d", True), ("e", True)]}),
        ("def f(a,  # the first\n      b=(1, 2)):\n    'def g(x): pass'\n",
         {"f": [("a", False), ("b", True)]}),
        ("cdef int f(int a) except -1:\n    pass\ndef _g(a):\n    pass\n", {}),
        ("cpdef enum:\n    ONE = 1  # of many\n    TWO\ncdef enum:\n    NONE = 3\n",
         {"ONE": None, "TWO": None}),
        ("cpdef enum Fault:\n    BAD = 1\n    WORSE\n", {"Fault": ["BAD", "WORSE"]}),
        ("cdef class A(B):\n    cdef int hidden\n    cdef readonly int64_t[::1] seen  # by all\n"
         "    def __cinit__(self, x):\n        def inner(y):\n            pass\n"
         "    @property\n    def p(self):\n        return 1\n"
         "    cpdef int go(self, int n) except -1:\n        return 0\n",
         {"A": None, "A.seen": None, "A.init": [("x", False)], "A.p": None,
          "A.go": [("self", False), ("n", False)]}),
        ("SIZE = 4 * 2\nsmall = 3\n_OWN = 2\n", {"SIZE": None}),
    ],
)  # fmt: skip
def test_what_cython_declares_is_found(text, names):
    assert declared(text) == names


def test_what_a_stub_declares_is_found():
    text = (
        "class A:\n    n: int\n    @property\n    def p(self) -> int: ...\n"
        "    def f(self, a: int, b: int = ...) -> None: ...\n"
    )
    assert stubbed(text) == {
        "A": None,
        "A.n": None,
        "A.p": None,
        "A.f": [("self", False), ("a", False), ("b", True)],
    }
    with pytest.raises(TypeError, match="no declaration"):
        stubbed("Bytes = list[int]\n")


# --- constants -----------------------------------------------------------------------------------

#: These are twins, which tests/test_records.py compares.
TWINS = {"records.py", "records.pxd"}

ENUMERATED = re.compile(r"([A-Z][A-Z0-9_]*) = (.+)")


def value_of(text):
    """The value of an expression of numbers, or None: what names others is no value of its own."""
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except SyntaxError:
        return None
    if any(isinstance(node, (ast.Name, ast.Call, ast.Attribute)) for node in ast.walk(tree)):
        return None
    value = eval(compile(tree, "constant", "eval"), {})
    return value if type(value) in (int, float) else None


def constants_of(text):
    """Constants of a module, and entries of enumerations without a name, that have a value."""
    anonymous = False
    for indent, line in lines_of(STRINGS.sub("''", text)):
        if indent == 0:
            anonymous = re.match(r"cp?def enum ?:", line) is not None
        if (indent == 0 or anonymous) and (found := ENUMERATED.match(line)):
            value = value_of(found[2])
            if value is not None:
                yield found[1], value


def twice(texts):
    """Constants that two texts give the same value of their own."""
    places = defaultdict(set)
    for place, text in texts.items():
        for constant in constants_of(text):
            places[constant].add(place)
    return {constant: sorted(where) for constant, where in places.items() if len(where) > 1}


def test_no_constant_has_its_value_in_two_places():
    paths = [path for suffix in ("py", "pyx", "pxd") for path in ROOT.rglob(f"*.{suffix}")]
    found = twice({str(path.relative_to(ROOT)): path.read_text() for path in paths})
    doubled = {name: where for (name, _), where in found.items() if not TWINS.issuperset(where)}
    assert doubled == {}


def test_a_constant_that_is_copied_is_found():
    texts = {
        "a": "#: How many.\nROOM = 1 << 12\nOTHER = 3\n",
        "b": "cdef enum:\n    ROOM = 4096  # as in a\n    OTHER = 4\n",
        "c": "ROOM = HALF * 2\ncdef enum Kind:\n    OTHER = 3\n",
    }
    assert twice(texts) == {("ROOM", 4096): ["a", "b"]}
