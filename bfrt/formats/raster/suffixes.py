"""The suffixes of rasters, and the drivers of GDAL that read them: nothing else is tried."""

from __future__ import annotations

#: The driver of Esri's grids, which are text.
GRID = "AAIGrid"

#: A file of any other format, whatever its name, is refused.
DRIVERS = {
    ".tif": "GTiff",
    ".tiff": "GTiff",
    ".vrt": "VRT",
    ".asc": GRID,
    ".hgt": "SRTMHGT",
    ".img": "HFA",
    ".bil": "EHdr",
    ".flt": "EHdr",
    ".dem": "USGSDEM",
    ".dt0": "DTED",
    ".dt1": "DTED",
    ".dt2": "DTED",
}

#: What drivers are told when they open a file. By itself GDAL takes the numbers of a grid, all of
#: them, for integers of 32 bits where the first have no decimal point.
OPENINGS = {GRID: {"DATATYPE": "Float64"}}
