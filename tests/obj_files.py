"""OBJ files as tests write them: faces in any form."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from meshes import (
    FACES,
    VERTICES,
)

from bfrt.formats import source as source_module
from bfrt.store.model import Material

BAD = ["nan", "inf", "-inf", "1e39", "1e999"]
PLAIN = pytest.approx((*Material().color, *Material()[1:]))


def corner(index, form, n):
    """A corner in one of the forms there are."""
    return form.format(index + 1, index - n)


def obj(faces=FACES, vertices=VERTICES, forms=("{0}",), tail=""):
    """A file of vertices, then faces, whose corners take the forms in turn."""
    turn = itertools.cycle(forms)
    n = len(vertices)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.float64(vertices).tolist()]
    lines += ["f " + " ".join(corner(i, next(turn), n) for i in face) for face in faces]
    return "\n".join([*lines, tail]) + "\n"


def cut(patch, size):
    patch.setattr(source_module, "CHUNK_BYTES", size)


# --- what is read --------------------------------------------------------------------------------


DRESSED = (
    "# a comment \\\n"
    "\n"
    "o thing\n  g a b c\n"
    "v 0 0 0 # the first\n"
    "\tv\t1 \\\n 0\\\n .25\n"
    "vt 0 0\nvn 0 0 1\nvp 1\n"
    "v 1 1 0.75\nv 0 1 0.5 #\n#v 1 1 1\n"
    "v 9 9 9\nv 0.5 2 1.125\n"
    "s off\n"
    "f 1 2/1 6//1\n"
    "f \\\n 4/3 \\\n   3/3 2/2 \\\n 1/1 # four\n"
    "l 1 2 3\np 1\n"
    "fo 6 4 1\n"
    "f 1 2 3 6 4"
)

# --- materials -----------------------------------------------------------------------------------


LIBRARY = """# a library
newmtl red one
Kd 1 0 0
Ka 1 1 1
map_Kd red.png
newmtl glass
  Kd 0.5
  d 0.25 # seen through
  Ni 1.5
  illum 2
  Ks 0.9 0.9 0.9
newmtl\tmirror
Kd 0.1 0.2 0.3
Ks 0.2 0.4 0.3
Ns 50
illum 3
newmtl turned
Tr 0.75
newmtl halo
d -halo 0.5
newmtl spectral
Kd spectral a.rfl
newmtl bare
"""


def dressed(library, names):
    """A file of one triangle a material."""
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", f"mtllib {library}"]
    for name in names:
        lines += [f"usemtl {name}", "f 1 2 3"]
    return "\n".join(lines) + "\n"
