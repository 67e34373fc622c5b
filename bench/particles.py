"""bfrt beside OVITO: from a file of particles to a picture of them, under caps.

::

    python bench/particles.py --millions 1 4 16 64 --caps 256MiB 1GiB 4GiB 18GiB

Particles are spheres of one size at random in a cube, a NumPy file of positions. Each program is a
process of its own inside a memory cgroup, with its files dropped from the page cache before. OVITO
renders by Tachyon: 512 x 512, hard shadows, one ray a pixel. Told are seconds, the cgroup's peak or
how it died, and how much of the picture is particles, of which both have to see the same. Needs
root, for the cgroup, and ``pip install ovito``.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from capped import drop, run_capped
from peers import how

from bfrt.memory import parse_memory

RADIUS = 0.3
SIZE = 512
ANGLE = 40.0


def cloud(path: Path, count: int) -> None:
    """Positions, one in a unit cube on average, float32."""
    random = np.random.default_rng(1)
    side = count ** (1 / 3)
    file = np.lib.format.open_memmap(path, "w+", np.float32, (count, 3))
    for first in range(0, count, 1 << 20):
        block = file[first : first + (1 << 20)]
        block[:] = random.random(block.shape, np.float32) * side
    file.flush()


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


def measure(millions: float, caps: list[str], folder: Path, pictures: Path) -> None:
    count = round(millions * 1e6)
    source, seen = folder / "cloud.npy", folder / "seen"
    cloud(source, count)
    for cap in caps:
        for name in PROGRAMS:
            drop(source)
            picture = pictures / f"particles-{millions:g}-{name}.png"
            command = [__file__, "--one", name, str(source), str(count), str(picture), cap]
            start = time.perf_counter()
            status, peak = run_capped([*command, str(seen)], parse_memory(cap))
            seconds = time.perf_counter() - start
            print(
                f"{millions:6g} M  {cap:>7}  {name:6} {seconds:8.2f} s {peak >> 20:6} MiB  "
                f"{how(status) or seen.read_text()}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--millions", type=float, nargs="*", default=[1, 4])
    parser.add_argument("--caps", nargs="*", default=["256MiB", "1GiB", "4GiB"])
    parser.add_argument("--folder", type=Path, help="where files are made")
    parser.add_argument("--pictures", type=Path, default=Path(), help="where pictures are put")
    parser.add_argument("--one", nargs=6, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        name, source, count, picture, memory, seen = arguments.one
        part = PROGRAMS[name](Path(source), int(count), Path(picture), memory)
        Path(seen).write_text(f"{part:.4f}")
        return
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        for millions in arguments.millions:
            measure(millions, arguments.caps, Path(name), arguments.pictures)


if __name__ == "__main__":
    main()
