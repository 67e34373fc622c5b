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
