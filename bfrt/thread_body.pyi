from collections.abc import Callable
from queue import SimpleQueue

def serve(
    name: bytes,
    calls: SimpleQueue[Callable[[], object] | None],
    told: SimpleQueue[BaseException | None],
    first: Callable[[], object],
) -> None: ...
