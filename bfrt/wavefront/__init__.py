"""Rays that travel: a sharded scene on many machines, each of which has some of its shards.

::

    client                                           a worker, with some shards
    rays ─► records, in blocks ─► routing: entries    ┌──────────────────────────────────────┐
              ▲                     │ nearest first   │ ShardPlace ─► Session on these shards │
              │  (t, id) nearer?    └─ cargo ────────►│ trace, with the hit so far            │
              └──────── surfaces, counts ◄── cargo ───│ normals and uv of nearer hits         │
                                                      └──────────────────────────────────────┘

A ray goes to the carriers, workers with some shards, whose bounds it meets, the nearest first, with
the nearest hit that it has. It goes no further where the next bounds begin behind that hit. What
counts is the least (t, id), so that no order of arrival changes the answer. Of the geometry nothing
travels.

Of a picture the client has film and queues, and the depth loop (`frame`)::

    queue ─► Ferry: outboxes, one a carrier ─► Meeting ─► nearest hits ─► settle ─► film
      ▲                                                        │
      └─ rays that go on, elements of the film ◄─ HitShading ◄─┘  by the carrier of the object
"""

from bfrt.lazy import offering

#: Where each thing lies that other rooms ask for; ``__init__.pyi`` says the same to type checkers.
OFFERED = {
    "ALL": "bfrt.wavefront.scene:ALL",
    "ANY": "bfrt.wavefront.scene:ANY",
    "COUNT": "bfrt.wavefront.scene:COUNT",
    "Wanted": "bfrt.wavefront.scene:Wanted",
    "Wavefront": "bfrt.wavefront.scene:Wavefront",
    "nearest": "bfrt.wavefront.scene:nearest",
}

__getattr__ = offering(__name__, OFFERED)
