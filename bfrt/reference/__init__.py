"""Slow answers to compare the core with, and the core's own functions laid open for tests.

::

    every ray x every object ─┬─ exhaustive ─► _exhaustive: the core's kernels, no grid
                              └─ independent ─► shapes: NumPy, other formulas
                                      └── agree: do two answers agree, close calls left out?
    openness: ambient occlusion, by NumPy and `exhaustive`
    _kernels: inline functions of the core, one call at a time

Nothing else in bfrt imports this package.
"""
