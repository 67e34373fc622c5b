"""What a checkpoint is the state of: work with other settings that matter is refused."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bfrt.errors import SettingError
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.version import VERSION
from bfrt.view import Views

Identity = dict[str, Any]


def identity_of(what: str, store: Store, settings: Settings) -> Identity:
    """Return what identifies work on a scene: what is done, by which version, of which scene.

    Parameters
    ----------
    what : str
        The function: "render", "cast_rays" ...
    """
    return {
        "version": VERSION,
        "work": what,
        "scene": f"{store.checksum:08x}",
        "objects": store.objects,
        "refine": settings.refinement.name,
    }


def identity_of_render(store: Store, views: Views, settings: Settings) -> Identity:
    """Return what identifies a render: also all that changes its pictures.

    Memory, threads and the grid change nothing of it, and are left out.
    """
    cameras = views.cameras
    return _plain(
        {
            **identity_of("render", store, settings),
            "eye": _of_each([camera.eye for camera in cameras]),
            "at": _of_each([camera.at for camera in cameras]),
            "up": _of_each([camera.up for camera in cameras]),
            "angle": _of_each([camera.angle for camera in cameras]),
            "resolution": cameras[0].resolution,
            "samples": views.samples,
            "depth": views.depth,
            "aovs": views.aovs,
            **_light_of(views),
        }
    )


def _of_each(values: Sequence[Any]) -> Any:
    """Return the value of one view; of several a list."""
    return values[0] if len(values) == 1 else values


def _light_of(views: Views) -> dict[str, Any]:
    """Return what lights the pictures: of several views the lights of each."""
    lights = [view.illumination.facts()["lights"] for view in views.each]
    return {**views.illumination.facts(), "lights": _of_each(lights)}


def identity_of_conversion(sources: Sequence[str], settings: Mapping[str, Any]) -> Identity:
    """Return what identifies a conversion: its sources, in order, and all that changes the store.

    The target is left out, and memory, threads and scratch, which change nothing of it.
    """
    return _plain({"version": VERSION, "work": "convert", "sources": sources, **settings})


def check_same(folder: Path, found: Identity, expected: Identity) -> None:
    """Refuse the state of other work.

    Raises
    ------
    SettingError
        If it is; the message has the first setting that differs.
    """
    for name in (*expected, *found):
        if found.get(name) != expected.get(name):
            raise SettingError(
                f"checkpoint: {folder}: found the state of work with {name} "
                f"{_shown(found.get(name))}, expected {name} {_shown(expected.get(name))}: "
                "go on as it was begun, or name another folder"
            )


def _plain(identity: Identity) -> Identity:
    """Return it as it is read from a file: lists for tuples, Python's numbers for NumPy's."""
    made: Identity = json.loads(json.dumps(identity, default=_number))
    return made


def _number(value: Any) -> int | float:
    """Return a number of NumPy's as Python's."""
    number: int | float = value.item()
    return number


def _shown(value: object) -> str:
    return f"{json.dumps(value):.120}"
