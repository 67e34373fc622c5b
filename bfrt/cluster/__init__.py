"""Many machines, by Dask: rays and frames are split, and every worker has the whole scene.

::

    client                                        a worker process
    dask arrays ─► a task for each block ──────►  Place ─► Session, opened once ─► answers
    frame ─► a task for some rows of it ───────►  Place ─► Session ─► film's integers ─┐
    picture ◄── rows, put together ◄───────────────────────────────────────────────────┘

What travels is small: a store as its path and checksum, settings, a view; rays and answers travel
as Dask moves its blocks. Dask schedules, replaces workers and moves arrays; it is imported when it
is first asked for.
"""

from bfrt.lazy import offering

#: Where each thing lies that other rooms ask for; ``__init__.pyi`` says the same to type checkers.
OFFERED = {
    "Asked": "bfrt.cluster.asked:Asked",
    "Local": "bfrt.cluster.blocks:Local",
    "Place": "bfrt.cluster.place:Place",
    "ask_about_points": "bfrt.cluster.point_blocks:ask_about_points",
    "ask_in_blocks": "bfrt.cluster.blocks:ask_in_blocks",
    "client_of": "bfrt.cluster.engine:client_of",
    "is_lazy": "bfrt.cluster.engine:is_lazy",
    "render_shared": "bfrt.cluster.shared_frame:render",
}

__getattr__ = offering(__name__, OFFERED)
