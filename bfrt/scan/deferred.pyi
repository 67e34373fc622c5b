DELAYS_BYTES: int

class DeferredTests:
    def __init__(self, padding: float) -> None: ...
