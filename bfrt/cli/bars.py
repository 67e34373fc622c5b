"""Progress bars, where a terminal shows them and tqdm is installed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from bfrt.spd.recipe import SpdScene


def wants_bar(quiet: bool) -> bool:
    """Tell whether to show a progress bar: on a terminal, where tqdm is installed."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        return False
    try:
        import tqdm  # noqa: F401
    except ImportError:
        return False
    return True


@contextmanager
def reading_bar(*sources: str, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """Yield a reporter of the bytes read from input files, shown as a bar."""
    total = sum(path.stat().st_size for path in map(Path, sources) if path.is_file())
    with bar(total, "B", "convert", quiet or not total) as progress:
        yield progress


@contextmanager
def making_bar(scene: SpdScene, what: str, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """Yield a reporter of the objects made of a scene, shown as a bar with their rate."""
    with bar(scene.objects, " objects", what, quiet) as progress:
        yield progress


@contextmanager
def bar(total: int, unit: str, what: str, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """Yield a reporter that a bar shows, or None where no bar is wanted."""
    if not wants_bar(quiet):
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, unit_scale=True, desc=what) as shown:
        yield lambda done: shown.update(done - shown.n) and None
