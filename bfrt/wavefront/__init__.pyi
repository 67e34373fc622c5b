"""Offers each name to type checkers; the package imports it when it is first used."""

from bfrt.wavefront.scene import ALL, ANY, COUNT, Wanted, Wavefront, nearest

__all__ = ["ALL", "ANY", "COUNT", "Wanted", "Wavefront", "nearest"]
