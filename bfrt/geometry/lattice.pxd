"""The grid as Python holds it."""

from bfrt.geometry.grid cimport Grid


cdef class Lattice:
    cdef Grid grid
    cdef readonly object planes
    cdef readonly tuple shape
    cdef readonly tuple order
    cdef readonly double grow
