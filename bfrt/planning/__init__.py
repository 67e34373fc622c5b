"""``bfrt.plan``: what a render would take, told before any work.

::

    header, palette, tables of marks ─► GridPlanner, TreePlanner ─► Plan ─► tables, JSON
    Views, Settings, Capacities ──────►     (planner: waves of rays, spools, the frame)

``planned`` has the plan and what it assumes; ``planner`` works out what all plans have in common,
``grid`` and ``tree`` what each accelerator takes, ``ordering`` what a twin in spatial order takes.
``estimate`` chooses among them.
"""

from bfrt.lazy import offering

#: Where each thing lies that other rooms ask for; ``__init__.pyi`` says the same to type checkers.
OFFERED = {
    "Plan": "bfrt.planning.planned:Plan",
    "ordering_of": "bfrt.planning.ordering:ordering_of",
    "plan_of": "bfrt.planning.estimate:plan_of",
}

__getattr__ = offering(__name__, OFFERED)
