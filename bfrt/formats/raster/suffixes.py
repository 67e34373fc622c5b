"""The suffixes of rasters, and the drivers of GDAL that read them: nothing else is tried."""

from __future__ import annotations

#: A file of any other format, whatever its name, is refused.
DRIVERS = {
    ".tif": "GTiff",
    ".tiff": "GTiff",
    ".vrt": "VRT",
    ".asc": "AAIGrid",
    ".hgt": "SRTMHGT",
    ".img": "HFA",
    ".bil": "EHdr",
    ".flt": "EHdr",
    ".dem": "USGSDEM",
    ".dt0": "DTED",
    ".dt1": "DTED",
    ".dt2": "DTED",
}
