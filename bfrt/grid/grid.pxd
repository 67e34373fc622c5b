"""The grid as Python holds it."""

from bfrt.grid.planes cimport Planes


cdef class Grid:
    cdef Planes planes
    cdef readonly object tables
    cdef readonly tuple shape
    cdef readonly tuple order
    cdef readonly double padding
