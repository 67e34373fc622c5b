"""How a store's groups are made: the settings that are the same for all."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

from bfrt.errors import SettingError
from bfrt.store.hierarchy import Hierarchy

#: The order in which a store keeps its objects.
Order = Literal["given", "spatial", "auto"]


def checked_order(order: str) -> Order:
    """Return an order that there is.

    Raises
    ------
    SettingError
        If it is none.
    """
    for name in get_args(Order):
        if order == name:
            return name  # type: ignore[no-any-return]
    raise SettingError(f"order: found {order!r:.80}, expected given, spatial or auto")


class Making(NamedTuple):
    """Says how the groups of a store are made.

    Attributes
    ----------
    hierarchy : Hierarchy
        Settings of the box hierarchy.
    order : {"given", "spatial", "auto"}
    durable : bool
        Whether files outlive a loss of power.
    memory : int
        The budget of the whole process, bytes.
    """

    hierarchy: Hierarchy
    order: Order
    durable: bool
    memory: int
