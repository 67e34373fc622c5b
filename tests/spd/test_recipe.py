"""What all standard scenes share, on a scene small enough to read."""

from __future__ import annotations

import io

import numpy as np
import pytest

from bfrt.records import Kind
from bfrt.scene.model import Camera, Light, Material
from bfrt.spd.recipe import Part, SpdScene, phong_power


class Row(SpdScene):
    """Spheres in a row, one a block, red up to the last, which is green; then a pentagon."""

    name = "row"
    camera = Camera(eye=(0.0, 0.0, 0.0), at=(1.0, 0.0, 0.0))
    lights = (Light((1.0, 2.0, 1e-7)),)
    background = (0.0, 0.5, 1.0)
    materials = (Material((1.0, 0.0, 0.0)), Material((0.0, 1.0, 0.0)))

    @property
    def objects(self):
        return self.size + 1

    def blocks(self, limit=1):
        place = np.zeros(1, np.int64)
        for x in range(self.size):
            records = np.array([[x, 0, 0, 0.5]], np.float32)
            yield (Part(Kind.SPHERE, records, np.array([x == self.size - 1], np.uint32), place),)
        corners = np.arange(15, dtype=np.float32).reshape(5, 3)
        counts = np.array([5], np.int64)
        yield (Part(Kind.POLYGON, corners, np.ones(1, np.uint32), place, counts),)


def test_text_names_a_material_only_where_it_changes_across_blocks_too():
    file = io.StringIO()
    Row(3).write_nff(file)
    assert file.getvalue().splitlines() == [
        "b 0 0.5 1",
        "v",
        "from 0 0 0",
        "at 1 0 0",
        "up 0 0 1",
        "angle 45",
        "hither 1",
        "resolution 512 512",
        "l 1 2 1e-07",
        "f 1 0 0 1 0 1 0 1",
        "s 0 0 0 0.5",
        "s 1 0 0 0.5",
        "f 0 1 0 1 0 1 0 1",
        "s 2 0 0 0.5",
        "p 5",
        "0 1 2",
        "3 4 5",
        "6 7 8",
        "9 10 11",
        "12 13 14",
    ]


@pytest.mark.parametrize(
    ("degrees", "power"), [(0, 100000), (-1, 100000), (60, 1), (90, 1), (120, 1), (45, 2)]
)
def test_phong_power_halves_the_highlight(degrees, power):
    assert phong_power(degrees) == pytest.approx(power, rel=1e-12)
