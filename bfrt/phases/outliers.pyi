from bfrt.scene.store import Group, Store

class Outliers:
    count: int
    def __init__(self, store: Store, group: Group) -> None: ...
