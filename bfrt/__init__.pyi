"""Offers each name to type checkers; the module itself imports it when it is first used."""

from bfrt import spd
from bfrt.cleaning import clean
from bfrt.cluster.copies import copy_store
from bfrt.conversion.convert import convert
from bfrt.errors import (
    BfrtError,
    BudgetError,
    Cancelled,
    CheckpointError,
    DiskFullError,
    ResourceError,
    SceneError,
    SettingError,
    ShortReadError,
    StoreError,
    StreamError,
)
from bfrt.image.picture import Image
from bfrt.image.pictures import Images
from bfrt.planning.planned import Plan
from bfrt.progress import Progress
from bfrt.queries.camera import camera_rays
from bfrt.queries.question import Answer
from bfrt.scene import (
    Scene,
    cast_rays,
    contains,
    count_intersections,
    framing_camera,
    list_intersections,
    occluded,
    plan,
    render,
    turntable,
    visibility,
)
from bfrt.scene_writer import SceneWriter
from bfrt.sharded import ShardedScene
from bfrt.sharded import open_scene as open
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Camera, Light, Material
from bfrt.store.sun import Sun
from bfrt.streams.litter import Litter
from bfrt.terrain.viewshed import viewshed

__all__ = [
    "Answer",
    "BfrtError",
    "BudgetError",
    "Camera",
    "Cancelled",
    "CheckpointError",
    "DiskFullError",
    "Hierarchy",
    "Image",
    "Images",
    "Light",
    "Litter",
    "Material",
    "Plan",
    "Progress",
    "ResourceError",
    "Scene",
    "SceneError",
    "SceneWriter",
    "SettingError",
    "ShardedScene",
    "ShortReadError",
    "StoreError",
    "StreamError",
    "Sun",
    "camera_rays",
    "cast_rays",
    "clean",
    "contains",
    "convert",
    "copy_store",
    "count_intersections",
    "framing_camera",
    "list_intersections",
    "occluded",
    "open",
    "plan",
    "render",
    "spd",
    "turntable",
    "viewshed",
    "visibility",
]

__version__: str

def _interrupted(number: int, _: object) -> None: ...
def _take_interrupts() -> None: ...
def _command() -> int: ...
