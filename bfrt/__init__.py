"""Breadth-first ray tracing of scenes larger than memory.

>>> import bfrt
>>> bfrt.convert("scene.nff", "scene.bfrt")
>>> image = bfrt.render("scene.bfrt", memory="256MiB")
>>> image.save("scene.exr")
"""

from __future__ import annotations

from bfrt.lazy import offering
from bfrt.version import VERSION

#: Where each thing that is offered lies; ``__init__.pyi`` says the same to type checkers.
OFFERED = {
    "Answer": "bfrt.queries.question:Answer",
    "BfrtError": "bfrt.errors:BfrtError",
    "BudgetError": "bfrt.errors:BudgetError",
    "Camera": "bfrt.store.model:Camera",
    "Cancelled": "bfrt.errors:Cancelled",
    "CheckpointError": "bfrt.errors:CheckpointError",
    "DiskFullError": "bfrt.errors:DiskFullError",
    "Hierarchy": "bfrt.store.hierarchy:Hierarchy",
    "Image": "bfrt.image.picture:Image",
    "Images": "bfrt.image.pictures:Images",
    "Light": "bfrt.store.model:Light",
    "Litter": "bfrt.streams.litter:Litter",
    "Material": "bfrt.store.model:Material",
    "Plan": "bfrt.planning.planned:Plan",
    "Progress": "bfrt.progress:Progress",
    "ResourceError": "bfrt.errors:ResourceError",
    "Scene": "bfrt.scene:Scene",
    "SceneError": "bfrt.errors:SceneError",
    "SceneWriter": "bfrt.scene_writer:SceneWriter",
    "SettingError": "bfrt.errors:SettingError",
    "ShardedScene": "bfrt.sharded:ShardedScene",
    "ShortReadError": "bfrt.errors:ShortReadError",
    "StoreError": "bfrt.errors:StoreError",
    "StreamError": "bfrt.errors:StreamError",
    "Sun": "bfrt.store.sun:Sun",
    "camera_rays": "bfrt.queries.camera:camera_rays",
    "cast_rays": "bfrt.scene:cast_rays",
    "clean": "bfrt.cleaning:clean",
    "contains": "bfrt.scene:contains",
    "convert": "bfrt.conversion.convert:convert",
    "copy_store": "bfrt.cluster.copies:copy_store",
    "count_intersections": "bfrt.scene:count_intersections",
    "framing_camera": "bfrt.scene:framing_camera",
    "list_intersections": "bfrt.scene:list_intersections",
    "occluded": "bfrt.scene:occluded",
    "open": "bfrt.sharded:open_scene",
    "plan": "bfrt.scene:plan",
    "render": "bfrt.scene:render",
    "spd": "bfrt.spd",
    "turntable": "bfrt.scene:turntable",
    "viewshed": "bfrt.terrain.viewshed:viewshed",
    "visibility": "bfrt.scene:visibility",
}

__all__ = list(OFFERED)
__version__ = VERSION


#: The command can be interrupted while it is imported, which takes most of its start.
__getattr__ = offering(__name__, OFFERED)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
