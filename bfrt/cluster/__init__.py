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
