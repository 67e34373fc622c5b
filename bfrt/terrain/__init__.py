"""Lines of sight on a terrain: from a raster of heights to a raster of what is seen.

::

    viewshed ─► convert ─► scene                      all in a folder that goes at the end
       │                     │
       ├─► ground: heights of pixels ─► rays ─► occluded ─► what is seen, a byte a pixel
       │                                                             │
       └─► sheet: GeoTIFF, written by GDAL in a process of its own ◄─┘
"""
