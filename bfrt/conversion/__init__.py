"""Conversion of scene files to scene stores.

::

    convert ─► sources: files, each with its reader; standard scenes
       │          │
       │          ▼
       └───────► sinks ─► SceneWriter     one group for each source, prepared by threads

`bfrt.conversion.writing` writes one store, `bfrt.conversion.sharding` several. With a checkpoint,
`bfrt.conversion.kept` has the writer go on where a killed run was. `bfrt.conversion.views` takes
the camera of a file, and nothing else.
"""
