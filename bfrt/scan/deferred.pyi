DELAYS_BYTES: int

class Delays:
    def __init__(self) -> None: ...
