import os

UNKNOWN: tuple[int, ...]

def exchange(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool: ...
