"""Offers each name to type checkers; the package imports it when it is first used."""

from bfrt.wavefront.scene import ALL, ANY, COUNT, NEAREST, Wanted, Wavefront

__all__ = ["ALL", "ANY", "COUNT", "NEAREST", "Wanted", "Wavefront"]
