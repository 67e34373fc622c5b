MOST_CORNERS: int

class Tokens:
    @property
    def line(self) -> int: ...
    @property
    def token(self) -> bytes: ...
