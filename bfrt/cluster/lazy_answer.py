"""The answer of a query of dask arrays: dask arrays, which can be computed together as one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from bfrt.cluster.lazy_counters import ComputedAsArrays, LazyCounters
from bfrt.queries.question import Answer


class LazyAnswer(ComputedAsArrays, Answer):
    """Maps names to dask arrays, of the same dtypes and shapes as an `Answer`'s arrays.

    It is a collection of Dask's too: ``dask.compute`` of it is an `Answer`, ``dask.persist`` of it
    another one of these, and several can be computed together.

    Attributes
    ----------
    stats : LazyCounters
        The counters of the query, which compute as `bfrt.cluster.counters.ClusterStats`.
    """

    stats: Any

    def compute(self) -> Answer:
        """Compute all arrays and the counters."""
        import dask

        (answer,) = dask.compute(self)
        assert isinstance(answer, Answer)
        return answer

    def persist(self) -> LazyAnswer:
        """Compute all arrays and the counters, which stay where they are computed."""
        import dask

        (answer,) = dask.persist(self)
        assert isinstance(answer, LazyAnswer)
        return answer

    @property
    def _parts(self) -> list[Any]:
        return [*self.values(), self.stats]

    def __dask_graph__(self) -> Any:
        from dask.highlevelgraph import HighLevelGraph

        return HighLevelGraph.merge(*(part.__dask_graph__() for part in self._parts))

    def __dask_keys__(self) -> list[Any]:
        return [part.__dask_keys__() for part in self._parts]

    def __dask_layers__(self) -> tuple[str, ...]:
        return tuple(layer for part in self._parts for layer in part.__dask_layers__())

    def __dask_tokenize__(self) -> tuple[Any, ...]:
        return ("bfrt answer", [*self], self.__dask_keys__())

    def __dask_postcompute__(self) -> tuple[Callable[..., Answer], tuple[Any, ...]]:
        return computed, ([*self],)

    def __dask_postpersist__(self) -> tuple[Callable[..., LazyAnswer], tuple[Any, ...]]:
        return self._persisted, ()

    def _persisted(
        self, graph: Mapping[Any, Any], *, rename: Mapping[str, str] | None = None
    ) -> LazyAnswer:
        """Return this answer with its keys computed."""
        parts = []
        for part in self._parts:
            rebuild, state = part.__dask_postpersist__()
            keys = {_renamed(key, rename or {}) for key in _flat(part.__dask_keys__())}
            own = {key: graph[key] for key in keys}
            parts.append(rebuild(own, *state, rename=rename) if rename else rebuild(own, *state))
        return answer_of(dict(zip(self, parts, strict=False)), parts[-1])


def answer_of(arrays: Mapping[str, Any], stats: LazyCounters) -> LazyAnswer:
    """Return the answer that has these dask arrays and counters."""
    answer = LazyAnswer(arrays)
    answer.stats = stats
    return answer


def computed(results: Sequence[Any], names: Sequence[str]) -> Answer:
    """Return an answer from the blocks of its arrays, nested as their keys are."""
    from dask.array.core import finalize

    *columns, (stats,) = results
    answer = Answer({name: finalize(blocks) for name, blocks in zip(names, columns, strict=True)})
    answer.stats = stats
    return answer


def _flat(keys: Any) -> list[Any]:
    return [each for key in keys for each in _flat(key)] if isinstance(keys, list) else [keys]


def _renamed(key: Any, names: Mapping[str, str]) -> Any:
    if isinstance(key, tuple):
        return (names.get(key[0], key[0]), *key[1:])
    return names.get(key, key)
