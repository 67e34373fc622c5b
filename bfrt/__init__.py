"""Breadth-first ray tracing of scenes larger than memory.

>>> import bfrt
>>> bfrt.convert("scene.nff", "scene.bfrt")
>>> image = bfrt.render("scene.bfrt", memory="256MiB")
>>> image.save("scene.exr")
"""

from bfrt import spd
from bfrt.conversion import convert
from bfrt.errors import (
    BfrtError,
    BudgetError,
    Cancelled,
    DiskFullError,
    SceneError,
    SettingError,
    ShortReadError,
    StoreError,
    StreamError,
)
from bfrt.framing import framing_camera
from bfrt.image.picture import Image
from bfrt.planned import Plan
from bfrt.planning import plan
from bfrt.queries.casting import (
    Answer,
    cast_rays,
    count_intersections,
    list_intersections,
    occluded,
)
from bfrt.rendering import render
from bfrt.scene.hierarchy import Hierarchy
from bfrt.scene.model import Camera, Light, Material
from bfrt.scene.store import Store
from bfrt.scene.writer import SceneWriter
from bfrt.scene_file import Scene
from bfrt.scene_file import open_scene as open
from bfrt.scheduler import Progress

__version__ = "0.1.0"

__all__ = [
    "Answer",
    "BfrtError",
    "BudgetError",
    "Camera",
    "Cancelled",
    "DiskFullError",
    "Hierarchy",
    "Image",
    "Light",
    "Material",
    "Plan",
    "Progress",
    "Scene",
    "SceneError",
    "SceneWriter",
    "SettingError",
    "ShortReadError",
    "Store",
    "StoreError",
    "StreamError",
    "cast_rays",
    "convert",
    "count_intersections",
    "framing_camera",
    "list_intersections",
    "occluded",
    "open",
    "plan",
    "render",
    "spd",
]
