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
from bfrt.image.picture import Image
from bfrt.rendering import render
from bfrt.scene.hierarchy import Hierarchy
from bfrt.scene.model import Camera, Light, Material
from bfrt.scene.store import Store
from bfrt.scene.store import open_store as open
from bfrt.scene.writer import SceneWriter
from bfrt.scheduler import Progress

__version__ = "0.1.0"

__all__ = [
    "BfrtError",
    "BudgetError",
    "Camera",
    "Cancelled",
    "DiskFullError",
    "Hierarchy",
    "Image",
    "Light",
    "Material",
    "Progress",
    "SceneError",
    "SceneWriter",
    "SettingError",
    "ShortReadError",
    "Store",
    "StoreError",
    "StreamError",
    "convert",
    "open",
    "render",
    "spd",
]
