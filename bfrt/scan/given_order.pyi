from collections.abc import Sequence

from bfrt.store.stream import Stream

class GivenOrder:
    failed: int
    def __init__(self, streams: Sequence[Stream]) -> None: ...
    def check(self) -> None: ...
