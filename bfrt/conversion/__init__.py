"""Conversion of scene files to scene stores.

::

    convert ─► sources: files, each with its reader; standard scenes
       │          │
       │          ▼
       └───────► sinks ─► SceneWriter     one group for each source, prepared by threads

`bfrt.conversion.views` takes the camera of a file, and nothing else.
"""
