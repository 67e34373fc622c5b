"""One program's way from a file of particles to a picture of them, as a process.

::

    python bench/particle.py ovito cloud.npy 1000000 picture.png 1GiB seen

The file ``seen`` gets how much of the picture is particles.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

RADIUS = 0.3
SIZE = 512
ANGLE = 40.0


def view(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The eye, and the middle of the cube."""
    side = count ** (1 / 3)
    return np.array([-1.2, -1.5, 1.4]) * side, np.full(3, 0.5) * side


def with_bfrt(source: Path, count: int, picture: Path, memory: str) -> float:
    import bfrt

    eye, at = view(count)
    camera = bfrt.Camera(tuple(eye), tuple(at), (0, 0, 1), ANGLE, resolution=(SIZE, SIZE))
    with tempfile.TemporaryDirectory(dir=source.parent) as folder:
        store = Path(folder, "cloud.bfrt")
        bfrt.convert(source, store, radius=RADIUS, memory=memory, durable=False)
        image = bfrt.render(store, camera=camera, samples=1, memory=memory)
    image.save(picture)
    return float(np.isfinite(image.channels["Z"]).mean())


def with_ovito(source: Path, count: int, picture: Path, memory: str) -> float:
    from ovito.data import DataCollection
    from ovito.pipeline import Pipeline, StaticSource
    from ovito.vis import TachyonRenderer, Viewport

    eye, at = view(count)
    data = DataCollection()
    particles = data.create_particles(count=count)
    particles.create_property("Position", data=np.load(source, mmap_mode="r"))
    particles.vis.radius = RADIUS
    Pipeline(source=StaticSource(data=data)).add_to_scene()
    viewport = Viewport(
        type=Viewport.Type.Perspective, camera_pos=tuple(eye), camera_dir=tuple(at - eye),
        fov=math.radians(ANGLE),
    )  # fmt: skip
    renderer = TachyonRenderer(ambient_occlusion=False, antialiasing=False)
    image = viewport.render_image(size=(SIZE, SIZE), renderer=renderer, alpha=True)
    image.save(str(picture))
    pixels = np.frombuffer(image.convertToFormat(image.Format.Format_RGBA8888).constBits(), "u1")
    return float((pixels.reshape(-1, 4)[:, 3] > 0).mean())


PROGRAMS: dict[str, Callable[[Path, int, Path, str], float]] = {
    "bfrt": with_bfrt,
    "ovito": with_ovito,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program", choices=tuple(PROGRAMS))
    parser.add_argument("source", type=Path)
    parser.add_argument("count", type=int)
    parser.add_argument("picture", type=Path)
    parser.add_argument("memory", help="of bfrt")
    parser.add_argument("seen", type=Path)
    given = parser.parse_args()
    part = PROGRAMS[given.program](given.source, given.count, given.picture, given.memory)
    given.seen.write_text(f"{part:.4f}")


if __name__ == "__main__":
    main()
