"""Settings as a caller asks for them: defaults are those of the worker that does the work."""

from __future__ import annotations

import os
from dataclasses import dataclass

from bfrt.cluster.worker import Worker
from bfrt.errors import BudgetError
from bfrt.memory import format_memory, parse_memory
from bfrt.paths import path_of
from bfrt.settings import Settings


@dataclass(frozen=True)
class Asked:
    """Holds the settings of a render or a query for any worker, checked as far as a client can.

    Attributes
    ----------
    memory : str or int, optional
        The budget of each worker's process.
    threads : int, optional
        Threads of each worker.
    refine : str
    grid, max_grid : int, optional
    fresh_marks : bool
        As for `bfrt.render`.
    scratch : str, optional
        A folder that each worker has.

    Raises
    ------
    SettingError
        For the first that cannot be honoured.
    """

    memory: str | int | None
    threads: int | None
    refine: str
    grid: int | None
    max_grid: int | None
    fresh_marks: bool
    scratch: str | os.PathLike[str] | None

    def __post_init__(self) -> None:
        of_grid = self.grid, self.max_grid, self.fresh_marks
        Settings.of(self.memory, self.threads, self.refine, *of_grid)
        if self.scratch is not None:
            folder = path_of("scratch", self.scratch).absolute()
            object.__setattr__(self, "scratch", os.fspath(folder))

    def settings(self, worker: Worker, *, fresh_marks: bool = False) -> Settings:
        """Return the settings of a worker.

        Parameters
        ----------
        worker : Worker
        fresh_marks : bool
            Whether marks are made again, where that is asked for: one task of all does it.

        Raises
        ------
        BudgetError
            If the budget is more than the worker may take.
        SettingError
            If the worker has no such scratch folder.
        """
        memory = worker.default if self.memory is None else parse_memory(self.memory)
        if memory > worker.most:
            raise BudgetError(
                f"memory: found {format_memory(memory)}, expected {worker.most >> 20}MiB or less: "
                f"{worker.name} is paused or ended beyond that"
            )
        threads = worker.threads if self.threads is None else self.threads
        fresh = fresh_marks and self.fresh_marks
        return Settings.of(
            memory, threads, self.refine, self.grid, self.max_grid, fresh, self.scratch
        )
