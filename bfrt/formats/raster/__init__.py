"""Terrain rasters, by GDAL in a process of its own: heights on a lattice, two triangles a cell.

::

    reader ─► remote: rows of heights ══ bfrt.formats.remote ══► child ─► rasterio, GDAL
       │                  facts: size, transform, reference system
       ▼
     cells: corners, triangles ─► ObjectWriter

GDAL takes memory for a whole block of a file, of whatever size that says, and has its own cache: in
the child both have a limit (`bfrt.formats.raster.child`). It takes 0 for what is no number in the
text of an Esri grid, which is therefore read before (`bfrt.formats.raster.esri_grid`).
"""
