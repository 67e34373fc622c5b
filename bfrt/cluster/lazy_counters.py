"""The counters of a query of dask arrays: a collection of Dask's that is computed as arrays are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from bfrt.cluster.counters import ClusterStats
from bfrt.cluster.engine import dask_array


class ComputedAsArrays:
    """Has Dask optimize a collection together with dask arrays.

    Dask puts together those that have the same function for it. Each of the others gets its own
    copy of the tasks that Dask has fused, and blocks of rays would be traced for each.
    """

    @property
    def __dask_optimize__(self) -> Any:
        return dask_array().Array.__dask_optimize__

    @property
    def __dask_scheduler__(self) -> Any:
        return dask_array().Array.__dask_scheduler__


class LazyCounters(ComputedAsArrays):
    """Stands for the counters of a query, until they are computed.

    Parameters
    ----------
    key : str
        Of the task that has them, and of its layer.
    graph : dask.highlevelgraph.HighLevelGraph
    """

    def __init__(self, key: str, graph: Any) -> None:
        self._key = key
        self._graph = graph

    def compute(self) -> ClusterStats:
        """Compute them, and all that they are counted of."""
        import dask

        (stats,) = dask.compute(self)
        assert isinstance(stats, ClusterStats)
        return stats

    def persist(self) -> LazyCounters:
        """Compute them; they stay where they are computed."""
        import dask

        (counters,) = dask.persist(self)
        assert isinstance(counters, LazyCounters)
        return counters

    def __dask_graph__(self) -> Any:
        return self._graph

    def __dask_keys__(self) -> list[str]:
        return [self._key]

    def __dask_layers__(self) -> tuple[str, ...]:
        return (self._key,)

    def __dask_tokenize__(self) -> str:
        return self._key

    def __dask_postcompute__(self) -> tuple[Callable[..., ClusterStats], tuple[Any, ...]]:
        return only, ()

    def __dask_postpersist__(self) -> tuple[Callable[..., LazyCounters], tuple[Any, ...]]:
        return counters_of, (self._key, ())


def only(results: Sequence[ClusterStats]) -> ClusterStats:
    """Return the one result."""
    (stats,) = results
    return stats


def counters_of(
    layer: Mapping[Any, Any],
    key: str,
    dependencies: Sequence[Any],
    *,
    rename: Mapping[str, str] | None = None,
) -> LazyCounters:
    """Return the counters that a key of a layer has.

    Parameters
    ----------
    layer : mapping
        Of Dask's tasks.
    key : str
    dependencies : sequence of collections
        Which the layer names tasks of.
    rename : mapping, optional
        Of keys, as Dask asks for it.
    """
    from dask.highlevelgraph import HighLevelGraph

    key = (rename or {}).get(key, key)
    graph = HighLevelGraph.from_collections(key, layer, dependencies=dependencies)
    return LazyCounters(key, graph)
