"""Ray queries: a caller's rays in place of a camera's, and the arrays of the answer.

::

    arrays, .npy files, blocks ─► RayQueue ─► Tracer ─► spool of hits
         (rays)                                             │ by object: surfaces, normals and uv
                                                            │ by ray: answers
                                                         Columns ─► new arrays, the caller's, files

``casting`` has an object for each query, which `bfrt.Scene` asks; ``visibility`` and
``containment`` have those about points, whose rays ``points`` adds up. ``given`` knows what callers
give.
"""

from bfrt.lazy import offering

#: Where each thing lies that other rooms ask for; ``__init__.pyi`` says the same to type checkers.
OFFERED = {
    "ANY_HIT": "bfrt.queries.casting:ANY_HIT",
    "Answer": "bfrt.queries.question:Answer",
    "CONTAINS": "bfrt.queries.containment:CONTAINS",
    "COUNT": "bfrt.queries.casting:COUNT",
    "Extras": "bfrt.queries.extras:Extras",
    "Given": "bfrt.queries.given:Given",
    "LIST": "bfrt.queries.casting:LIST",
    "Out": "bfrt.queries.answers:Out",
    "PointQuestion": "bfrt.queries.points:PointQuestion",
    "Points": "bfrt.queries.given:Points",
    "Question": "bfrt.queries.question:Question",
    "RaysGiven": "bfrt.queries.question:RaysGiven",
    "nearest": "bfrt.queries.casting:nearest",
    "visibility_of": "bfrt.queries.visibility:visibility",
}

__getattr__ = offering(__name__, OFFERED)
