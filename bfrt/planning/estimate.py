"""``bfrt.plan``: what a render would take, told before any work.

Read are the header of the store, its palette and the tables of its marks; of objects nothing. What
a budget decides comes from the code that decides it in a render, and is exact. How many rays go on,
how many passes they need and how much a pass reads depend on what they meet: these are estimates,
from `ASSUMED`.
"""

from __future__ import annotations

from bfrt.budget import Capacities, GridCapacities, TreeCapacities
from bfrt.planning.grid import GridPlanner
from bfrt.planning.planned import Plan
from bfrt.planning.tree import TreePlanner
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.view import Views


def plan_of(
    store: Store, views: Views, settings: Settings, held: Capacities, *, kept: bool = False
) -> Plan:
    """Plan a render of views with the capacities of its budget, for `bfrt.plan`.

    Parameters
    ----------
    kept : bool
        Whether its state is kept in a checkpoint.
    """
    if isinstance(held, TreeCapacities):
        return TreePlanner(store, views, settings, held).plan(kept)
    assert isinstance(held, GridCapacities)
    return GridPlanner(store, views, settings, held).plan(kept)
