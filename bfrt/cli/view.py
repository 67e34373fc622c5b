"""Options of the view, or of several, and the cameras that they ask for."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import bfrt
from bfrt.conversion.view_list import read_views
from bfrt.conversion.views import read_view
from bfrt.errors import SceneError, SettingError
from bfrt.framing import framing_camera, turntable
from bfrt.store.model import Camera
from bfrt.store.store import Store


def add_view(made: argparse.ArgumentParser) -> None:
    """Add the options that say from where a picture is taken."""
    made.add_argument(
        "--resolution", type=int, nargs=2, metavar=("W", "H"), help="in pixels; or as WxH"
    )
    made.add_argument(
        "--view", metavar="FILE|NAME",
        help=f"take the view (v) of this NFF file, or one of: {', '.join(bfrt.spd.VIEWS)}",
    )  # fmt: skip
    vector: dict[str, Any] = {"type": float, "nargs": 3, "metavar": ("X", "Y", "Z")}
    made.add_argument("--from", dest="eye", help="where the eye is", **vector)
    made.add_argument("--at", help="what it looks at", **vector)
    made.add_argument("--up", help="which way is up", **vector)
    made.add_argument("--angle", type=float, help="degrees from bottom to top")
    several = made.add_mutually_exclusive_group()
    several.add_argument(
        "--turntable", type=int, metavar="N",
        help="N views around the scene, from this one on, which share all passes; an output has a "
        "place for a view's number then, as view-{:03d}.png or view-%%03d.png",
    )  # fmt: skip
    several.add_argument(
        "--views", metavar="FILE",
        help="views of this file, likewise: one a line (from, at, up, angle), or NFF's v blocks",
    )  # fmt: skip


def is_of_several(options: argparse.Namespace) -> bool:
    """Tell whether several views are asked for, if only one comes of it."""
    return options.turntable is not None or options.views is not None


def cameras_of(options: argparse.Namespace, store: Store) -> Camera | list[Camera]:
    """Return the camera to render with, or those of several views."""
    if options.views is not None:
        return listed_views(options, store)
    camera = camera_of(options, store)
    return camera if options.turntable is None else turntable(store, options.turntable, camera)


def first_of(cameras: Camera | list[Camera]) -> Camera:
    """Return the camera to render with, of several the first."""
    return cameras if isinstance(cameras, Camera) else cameras[0]


def listed_views(options: argparse.Namespace, store: Store) -> list[Camera]:
    """Return the views of a file, with the resolution that is asked for."""
    for name in ("view", "eye", "at", "up", "angle"):
        if getattr(options, name) is not None:
            flag = "from" if name == "eye" else name
            raise SettingError(f"--{flag}: found it with --views, expected the file to say it")
    own = Camera.resolution if store.camera is None else store.camera.resolution
    cameras = read_views(options.views, own)
    if options.resolution is None:
        sizes = list(dict.fromkeys(camera.resolution for camera in cameras))
        if len(sizes) > 1:
            raise SettingError(
                f"{options.views}: found views of {sizes[0]} and of {sizes[1]} pixels, expected "
                "one resolution for all, or --resolution"
            )
        return cameras
    try:
        return [replace(camera, resolution=tuple(options.resolution)) for camera in cameras]
    except SceneError as error:
        raise SettingError(str(error)) from None


def camera_of(options: argparse.Namespace, store: Store) -> Camera:
    """Return the camera to render with: the store's, a named view's, or one that frames the scene,
    with the changes that the command line asks for.
    """
    camera = store.camera if options.view is None else view_of(options.view)
    asked = {
        "eye": options.eye and tuple(options.eye),
        "at": options.at and tuple(options.at),
        "up": options.up and tuple(options.up),
        "angle": options.angle,
        "resolution": options.resolution and tuple(options.resolution),
    }
    changes: dict[str, Any] = {key: value for key, value in asked.items() if value is not None}
    try:
        return framing_camera(store, **changes) if camera is None else replace(camera, **changes)
    except SceneError as error:  # the store's camera is one: the changes are wrong
        raise SettingError(str(error)) from None


def view_of(name: str) -> Camera:
    """Return the camera of a view of `bfrt.spd.VIEWS`, or of an NFF file."""
    return bfrt.spd.VIEWS[name] if name in bfrt.spd.VIEWS else read_view(name)
