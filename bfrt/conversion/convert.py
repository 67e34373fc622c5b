"""The conversion of scene files and standard scenes to a store: each becomes a group."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

from bfrt.checkpoint.checkpoint import Checkpoint, keeping
from bfrt.checkpoint.identity import identity_of_conversion
from bfrt.cluster.engine import client_of
from bfrt.conversion.by_workers import by_workers
from bfrt.conversion.kept import EVERY, KeptConversion, check_can_be_kept, find_state
from bfrt.conversion.sharding import Make, Sharding, is_sharded, one_by_one, refuse_checkpoint
from bfrt.conversion.sources import SceneSource, sources_of
from bfrt.conversion.writing import Conversion, write_scene, writing_of
from bfrt.formats.reading import Reading, Uses
from bfrt.memory import default_memory, parse_memory
from bfrt.paths import check_apart, path_of, without_links
from bfrt.progress import DoneReport, check_report
from bfrt.refusals import in_memory
from bfrt.scene import PathLike, Scene
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Order, checked_order

log = logging.getLogger(__name__)


def convert(
    source: PathLike | Sequence[PathLike],
    target: PathLike,
    *,
    dtype: Any = None,
    hierarchy: Hierarchy | None = None,
    order: Order = "auto",
    memory: str | int | None = None,
    scratch: PathLike | None = None,
    radius: float | str | None = None,
    positions: str | None = None,
    color_by: str | None = None,
    colormap: str | None = None,
    color_range: tuple[float | str, float | str] | None = None,
    color_log: bool = False,
    column_names: str | None = None,
    frame: int | None = None,
    opacity: float | None = None,
    skip_invalid: bool = False,
    triangulate: bool = False,
    polygons: bool = False,
    smooth: bool = False,
    external_storage: bool = False,
    band: int | None = None,
    height_scale: float | None = None,
    curvature: float | None = None,
    floor: float | None = None,
    progress: DoneReport | None = None,
    durable: bool = True,
    checkpoint: PathLike | Checkpoint | None = None,
    every: float = EVERY,
    shards: int | None = None,
    client: Any = None,
) -> Scene:
    """Convert scene files to a scene store, or to a sharded scene of several, streaming.

    Parameters
    ----------
    source : path-like, or sequence of path-like
        A file of NFF, PLY, STL, OBJ, OFF, NumPy (.npy, .npz), HDF5, LAS or LAZ, E57, PCD, LAMMPS
        dumps, points of text (.xyz, .csv, .txt, .pts, .asc), or a raster of heights (.tif and
        others that GDAL opens); what is text may be packed by gzip (.gz). "-" is NFF from standard
        input, ``spd:NAME:SIZE`` a standard scene. Of several, each becomes a group with a grid of
        its own, which suits a small dense thing in a large sparse one. The view, the lights and
        the background are the first file's. A setting applies to the files that use it.
    target : path-like
        The store to make. An existing store is replaced when the new one is complete; anything
        else is refused. With the suffix .bfrts it is a sharded scene: a file that names stores,
        which are made one by one, in a folder beside it of the same name with .shards. Those that
        are complete stay where the work ends early: the same call goes on from there, and makes
        no shard again whose files are as they were (docs/shards.rst).
    dtype : {None, "float32", "float64"}
        The type that geometry is stored as. None keeps the file's own: float32 or float64 by its
        types, and float64 for text without types (OBJ, text STL). If all sources are NFF or
        standard scenes, or all are rasters, None is float32.
    hierarchy : Hierarchy, optional
        Settings of the box hierarchy. By default `Hierarchy`'s, and for a standard scene the
        paper's settings for that scene.
    order : {"auto", "given", "spatial"}
        The order in which objects are stored: as they are given; spatial, in treelets, for
        ``refine="tree"``; or auto, which is spatial, since that costs little (docs/tree.rst). Ids
        count in the order given, always. Objects are brought into order when all are read: until
        that is done the disk needs up to three times the store's bytes.
    memory : str or int, optional
        The budget of the whole process: ``"256MiB"`` or bytes. By default a quarter of the
        machine's memory, or of its cgroup's limit. The least depends on the files, 53 MiB for small
        ones, and on the order: the order given may take less. A mesh whose vertices take more is
        joined on disk, in forward passes. The store is the same whatever the budget is.
    scratch : path-like, optional
        Folder for the temporary files of such a join. By default the target's parent.
    radius : float or str, optional
        The radius of points, in the file's units, or the name of the column or array with a radius
        for each point; "auto" for the points' spacing, the median distance to the nearest of 256
        of them, which costs two passes and is logged; or radii of types, as "1=0.5,2=0.8".
    positions : str, optional
        Name of the array or dataset with the points' positions, or of the group with x, y and z.
    color_by : str, optional
        Name of the column or array of numbers that a color map turns into colors; "rgb" for the
        file's own colors, which are rounded to 65,536. A face has the mean of its vertices.
    colormap : str, optional
        The map: "viridis", the default, "cubehelix" or "gray"; with matplotlib any of its maps.
    color_range : (float or str, float or str), optional
        The numbers that get the map's first and last color, or percentiles of all numbers, as
        ``("2%", "98%")``: the least number that so many are not above. By default the least and the
        greatest number, which costs a pass over the file; percentiles cost up to four.
    color_log : bool
        Make equal ratios of numbers equal steps of the map; numbers of 0 and below are gray, as
        what is no number.
    column_names : str, optional
        Names for the columns of points of text, parted by commas or blanks, in place of what the
        file has; "-" for a column that is not wanted.
    frame : int, optional
        Of several frames, as LAMMPS dumps, H5MD, H5Part and openPMD have, the one to read: from 0,
        or from -1 back. By default the last.
    opacity : float, optional
        Of Gaussian splats only those are read that are as opaque as that, 0 to 1.
    skip_invalid : bool
        Drop objects that are not finite and faces of fewer than three corners, and log how many. By
        default they are refused.
    triangulate : bool
        Store all faces of more than three corners as triangles, a face of k corners as k - 2. By
        default faces that are not flat become triangles, with a logged count, and flat ones
        polygons.
    polygons : bool
        Store all faces of more than three corners as polygons, each in the plane that fits it.
    smooth : bool
        Store faces whose corners have normals in the file as patches, which are shaded by them:
        OBJ's ``vn``, PLY's ``nx ny nz``, an array ``normals`` beside ``vertices``. Those of more
        corners become triangles before. By default normals are passed over, which is logged.
    external_storage : bool
        Follow HDF5's external storage: rows that are in files of any kind, which a dataset names.
        It reads whatever this process may read: it is for files that one trusts. By default such a
        dataset is refused.
    band : int, optional
        The band of a raster that has the heights, from 1. By default the first.
    height_scale : float, optional
        What heights of a raster are multiplied by, so that they are in units of x and y. It is
        asked for where those are degrees.
    curvature : float, optional
        The part of the earth's curvature by which a raster's heights are lowered, from its middle:
        1 for all of it, 1 - k where the air bends light by the refraction k, as gdal_viewshed's
        -cc. Lines of sight are straight then, between any two points. By default 0.
    floor : float, optional
        A height, in units of x and y, down to which walls stand around the cells that a raster has
        not: a line of sight that comes through there does not pass below the ground beside. By
        default there are none.
    progress : callable, optional
        Called with the number of bytes read so far, of all files; and after that, of a store in
        spatial order, with the number of objects that are in order. The number is a
        `bfrt.progress.Done`, which tells the stage, "reading" or "ordering", and the total.
        Returning False cancels.
    durable : bool
        Whether the store outlives a loss of power; not needed for one that is soon removed.
    checkpoint : path-like, optional
        Folder, in the file system of the target, in which the store is made and its state is kept:
        the same call goes on from there after a kill, and does not read again the sources that
        were complete; the store has the same bytes (docs/checkpoints.rst). It is removed when the
        store is complete.
    every : float
        Seconds between two saves of the state at the least; it is saved when a source is complete,
        or a stream is in order, and where that takes long less often: it costs no more than a
        fiftieth of the time. 0 means every time, whatever it costs.
    shards : int, optional
        Number of the stores of a sharded scene, each of some files in order; by default one for
        each file. Groups, ids and pictures do not depend on it.
    client : distributed.Client or True, optional
        Have the workers of a Dask cluster make the shards, each by one worker, which reads its
        files itself; True is the current client. Files and target are where all machines see them.
        `memory` is each worker's, and by default a quarter of its limit; `progress` counts the
        files whose shards are complete.

    Returns
    -------
    Scene
        The new store, opened.

    Raises
    ------
    SceneError, ShortReadError
        If a file is damaged or no scene: one line with file, place, what was found and what was
        expected. Nothing is left behind.
    BudgetError
        If the budget is below the least that works, which the message names.
    SettingError
        If no reader knows a file's suffix, a setting does not fit the file, or no file uses it; if
        `checkpoint` has the state of other work, or a source that was complete has changed.
    CheckpointError
        If the state in `checkpoint`, or a file of the store there, is damaged.
    DiskFullError, StreamError
        If the system refuses a read or a write; nothing is left behind.
    Cancelled
        If `progress` returned False; nothing is left behind.
    """
    order = checked_order(order)
    sources = sources_of(source)
    beside = without_links(path_of("store", target)).parent
    check_report(progress)
    reading = Reading(
        radius=radius,
        positions=positions,
        color_by=color_by,
        colormap=colormap,
        color_range=color_range,
        color_log=color_log,
        column_names=column_names,
        frame=frame,
        opacity=opacity,
        skip_invalid=skip_invalid,
        triangulate=triangulate,
        polygons=polygons,
        smooth=smooth,
        external_storage=external_storage,
        band=band,
        height_scale=height_scale,
        curvature=curvature,
        floor=floor,
        scratch=beside if scratch is None else path_of("scratch", scratch),
        uses=Uses(len(sources)),
    )
    asked = None if memory is None else parse_memory(memory)
    budget = asked or default_memory()
    writing = writing_of(sources, target, dtype, hierarchy, order)
    conversion = Conversion(sources, reading, budget, writing, durable)
    with in_memory(f"{conversion.names}: converting", budget):
        if is_sharded(target, shards, client):
            refuse_checkpoint(checkpoint)
            scene = Sharding(conversion, shards, asked).run(maker_of(sources, client, progress))
        else:
            scene = written(conversion, checkpoint, every, progress)
    if not scene.objects:
        log.warning("%s: no object was found", conversion.names)
    return scene


def maker_of(sources: tuple[SceneSource, ...], client: Any, progress: DoneReport | None) -> Make:
    """Return what makes shards: this process, or the workers of a client."""
    if client is None:
        return one_by_one(sources, progress)
    return by_workers(client_of(client), sources, progress)


def written(
    conversion: Conversion,
    checkpoint: PathLike | Checkpoint | None,
    every: float,
    progress: DoneReport | None,
) -> Scene:
    """Write the sources to one store, from where the state in a checkpoint ends, if any."""
    if checkpoint is None:
        return write_scene(conversion, progress)
    check_can_be_kept(conversion.files)
    if not isinstance(checkpoint, Checkpoint):
        check_apart(conversion.writing.target, checkpoint)
    names = [source.name for source in conversion.sources]
    with keeping(checkpoint, every, each=0.0) as opened:
        assert opened is not None
        find_state(opened, identity_of_conversion(names, conversion.settings))
        with KeptConversion(opened, conversion.files, conversion.reading.uses) as kept:
            kept.check_inputs()
            store = kept.named(conversion.writing.target)
            return write_scene(conversion, progress, kept) if store is None else Scene(store)
