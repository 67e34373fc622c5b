"""The sharded scene: a JSON file that names stores, each with some groups of one scene.

::

    scene.bfrts ── manifest ──►  origin, bounds, view, lights, and of each shard: path, identity,
         │                       number of its first group, streams, bounds
         │ open_any
         ▼
    ShardedStore ─┬─ store 0    groups 0 ..        one scene: a group's number, and so an id, is
                  ├─ store 1    groups n ..        what it would be in one store of all files
                  └─ ...

Whatever traces rays through the groups of a store traces them through a sharded scene.
"""
