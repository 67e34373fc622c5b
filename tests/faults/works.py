"""All works, by their names, and what is beyond us in them."""

from __future__ import annotations

from functools import partial

from faults.conversions import CONVERSIONS
from faults.several import copying, sharded, sharding, verifying, views, writing
from faults.work import (
    Work,
    as_given,
    asked,
    asking,
    asking_points,
    broken_off_conversion,
    converted,
    converting,
    keeping,
    looking,
    many,
    on_disk,
    past_the_cache,
    rendered,
    rendering,
    resuming,
    saving,
    tight,
    two_files,
)

#: Faults at which a library ends the process, or prints, before anybody else hears of them.
BEYOND = {
    # lazrs is written in Rust, where memory that is refused ends the process, and it prints where
    # its threads are refused.
    "convert laz": ("memory ENOMEM", "memory ENOMEM lasting", "thread EAGAIN",
                    "thread EAGAIN lasting"),
    # HDF5 reads through a null pointer where all of its requests are refused.
    "convert hdf5": ("memory ENOMEM lasting",),
    "convert hdf5, gzip": ("memory ENOMEM lasting",),
    "convert hdf5, virtual": ("memory ENOMEM lasting",),
}  # fmt: skip

WORKS: dict[str, Work] = {
    **{name: converting(*asked, **how) for name, (asked, how) in CONVERSIONS.items()},
    "viewshed": looking(),
    "render by treelets": rendering("tree"),
    "render by treelets, spooled": rendering("tree", on_disk, ".png"),
    "render by treelets, past the cache": rendering("tree", past_the_cache, ".npy", many),
    "render by a grid": rendering("sgb", None, ".npy", as_given),
    "render by a grid, spooled": rendering("sgb", on_disk, ".exr", as_given),
    "cast_rays": asking("cast_rays", "tree"),
    "cast_rays, spooled": asking("cast_rays", "sgb", tight),
    "occluded": asking("occluded", "tree", tight),
    "count_intersections": asking("count_intersections", "sgb"),
    "list_intersections": asking("list_intersections", "tree"),
    "cast_rays, past the cache": asking("cast_rays", "tree", past_the_cache, many),
    "list_intersections, spooled": asking("list_intersections", "tree", tight),
    "visibility, spooled": asking_points("visibility", "tree", tight, rays=5),
    "contains": asking_points("contains", "sgb", None, as_given),
    "convert, kept": Work(two_files, converted, resumes=True),
    "convert, resumed": Work(broken_off_conversion, converted, resumes=True),
    "render by treelets, kept": keeping(partial(rendered, "tree"), "auto"),
    "render by treelets, resumed": resuming(partial(rendered, "tree"), "auto"),
    "render by a grid, kept": keeping(partial(rendered, "sgb"), "given"),
    "render by a grid, resumed": resuming(partial(rendered, "sgb"), "given"),
    "cast_rays, kept": keeping(partial(asked, "cast_rays", "tree"), "auto"),
    "list_intersections, resumed": resuming(partial(asked, "list_intersections", "sgb"), "given"),
    "save exr": saving(".exr"),
    "save png": saving(".png"),
    "save npy": saving(".npy"),
    "convert to shards": sharding(),
    "render of shards": rendering("tree", None, ".npy", sharded, "s.bfrts"),
    "render of views": views("a-{}.png"),
    "save a sheet": views("a.png", "save_sheet"),
    "save an animation": views("a.gif", "save_animation"),
    "copy a store": copying(),
    "verify": verifying(),
    "write a scene": writing(),
}
