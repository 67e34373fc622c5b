"""What a module of Cython shows to Python, as its text declares it, and what its stub says."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

#: A name, and whether it may be left out.
Parameters = list[tuple[str, bool]]

#: By name, ``Class.method`` too: the parameters of a function, the members of an enumeration, or
#: None for a class, a property, an attribute or a constant.
Names = dict[str, "Parameters | list[str] | None"]

STRINGS = re.compile(r'"""[\s\S]*?"""|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'')
CLASS = re.compile(r"(?:cdef )?class (\w+)")
ENUM = re.compile(r"cpdef enum ?(\w*):")
FUNCTION = re.compile(
    r"(?:cp)?def [^(]*?(\w+)\((.*?)\)(?: except [^:]*)?(?: noexcept)?(?: nogil)?:?$"
)
ATTRIBUTE = re.compile(r"cdef (?:readonly|public) (.+)")
CONSTANT = re.compile(r"([A-Z][A-Z0-9_]*) = ")


def is_public(name: str) -> bool:
    return not name.startswith("_")


# --- Cython --------------------------------------------------------------------------------------


def declared(*texts: str) -> Names:
    """The public names of a .pyx and its .pxd."""
    found: Names = {}
    for text in texts:
        owner = enum = None
        before = ""
        for indent, line in lines_of(text):
            if indent == 0:
                owner, enum = class_of(line), enum_of(line)
                if owner:
                    found[owner] = None
                elif enum:
                    found[enum] = []
                elif constant := CONSTANT.match(line):
                    found[constant[1]] = None
            if enum is not None and indent:
                add_members(found, enum, line)
            elif indent == (4 if owner else 0):
                new = named(line, f"{owner}." if owner else "")
                found.update(dict.fromkeys(new) if before == "@property" else new)
            before = line
    return {name: found[name] for name in found if all(map(is_public, name.split(".")))}


def lines_of(text: str) -> Iterator[tuple[int, str]]:
    """Indents and statements: without comments and strings, each on one line."""
    text = re.sub(r"#.*", "", STRINGS.sub("''", text))
    held = ""
    for line in text.splitlines():
        held = f"{held} {line.strip()}" if held else line.rstrip()
        if held.count("(") + held.count("[") > held.count(")") + held.count("]"):
            continue
        if held.strip():
            yield len(held) - len(held.lstrip()), held.strip()
        held = ""


def class_of(line: str) -> str | None:
    found = CLASS.match(line)
    return found[1] if found else None


def enum_of(line: str) -> str | None:
    """The name of an enumeration, which may be empty."""
    found = ENUM.match(line)
    return found[1] if found else None


def add_members(found: Names, enum: str, line: str) -> None:
    """Members of an enumeration without a name are constants of the module."""
    for member in line.split(","):
        name = member.split("=")[0].strip()
        if enum:
            found[enum].append(name)  # type: ignore[union-attr, arg-type]
        elif name:
            found[name] = None


def named(line: str, owner: str) -> Names:
    """What a statement of a module or a class declares."""
    if function := FUNCTION.match(line):
        name = "__init__" if function[1] == "__cinit__" else function[1]
        parameters = [parameter(each) for each in parts_of(function[2])]
        if name == "__init__":
            return {f"{owner}init": parameters[1:]}
        return {f"{owner}{name}": parameters}
    if attribute := ATTRIBUTE.match(line):
        first, *more = attribute[1].split(",")
        return {f"{owner}{name.split()[-1]}": None for name in (first, *more)}
    return {}


def parts_of(text: str) -> list[str]:
    """What commas part that are in no brackets."""
    depth, parts = 0, [""]
    for letter in text:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def parameter(text: str) -> tuple[str, bool]:
    """A parameter's name, behind its type, and whether it has a default."""
    before, default, _ = text.partition("=")
    return re.findall(r"\w+", before.replace(" not None", ""))[-1], bool(default)


# --- stubs ---------------------------------------------------------------------------------------


def stubbed(text: str) -> Names:
    """The public names of a .pyi."""
    found: Names = {}
    for node in ast.parse(text).body:
        if isinstance(node, ast.ClassDef):
            found.update(of_class(node))
        else:
            found.update(of_statement(node, ""))
    return {name: found[name] for name in found if all(map(is_public, name.split(".")))}


def of_class(node: ast.ClassDef) -> Names:
    if any(isinstance(base, ast.Attribute) and base.attr == "IntEnum" for base in node.bases):
        return {node.name: [each.targets[0].id for each in node.body]}  # type: ignore[attr-defined]
    found: Names = {node.name: None}
    for each in node.body:
        found.update(of_statement(each, f"{node.name}."))
    return found


def of_statement(node: ast.stmt, owner: str) -> Names:
    if isinstance(node, ast.FunctionDef):
        if any(
            isinstance(each, ast.Name) and each.id == "property" for each in node.decorator_list
        ):
            return {f"{owner}{node.name}": None}
        given = node.args.args
        plain = len(given) - len(node.args.defaults)
        parameters = [(each.arg, at >= plain) for at, each in enumerate(given)]
        if node.name == "__init__":
            return {f"{owner}init": parameters[1:]}
        return {f"{owner}{node.name}": parameters}
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        return {f"{owner}{node.target.id}": None}
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        return {}
    raise TypeError(f"a stub has {ast.unparse(node)!r}, which is no declaration")
