"""Dask, which is imported when somebody asks for it: plain use does not wait for it."""

from __future__ import annotations

import sys
from typing import Any

from bfrt.errors import BfrtError, Cancelled, ResourceError, SettingError


def is_lazy(*given: object) -> bool:
    """Tell whether any of what is given is a dask array; there is none where dask is not in use."""
    array = getattr(sys.modules.get("dask.array"), "Array", None)
    return array is not None and any(isinstance(each, array) for each in given)


def dask_array() -> Any:
    """Return ``dask.array``, which is there where anything is a dask array."""
    import dask.array

    return dask.array


def distributed() -> Any:
    """Return ``distributed``.

    Raises
    ------
    SettingError
        If it is not installed.
    """
    try:
        import distributed
    except ImportError:
        raise SettingError("client: a cluster needs Dask: pip install bfrt[dask]") from None
    return distributed


def client_of(client: Any) -> Any:
    """Return the client that is meant: one that is given, or for True the current one.

    Raises
    ------
    SettingError
        If there is none, it is closed, or is one of another kind.
    """
    engine = distributed()
    if client is True:
        try:
            client = engine.default_client()
        except ValueError:
            raise SettingError(
                "client: found no current client, expected one, as dask.distributed.Client() "
                "makes it"
            ) from None
    if not isinstance(client, engine.Client):
        raise SettingError(
            f"client: found {type(client).__name__}, expected a dask.distributed.Client, or True "
            "for the current one"
        )
    if client.asynchronous:
        raise SettingError("client: found an asynchronous one, expected asynchronous=False")
    if client.status != "running":
        raise SettingError(f"client: found one that is {client.status}, expected one that runs")
    return client


def in_our_words(error: BaseException | None) -> BfrtError | None:
    """Return what Dask says of a client that waits in vain as an error of ours; else None."""
    engine = distributed()
    if isinstance(error, (engine.CancelledError, engine.client.ClosedClientError)):
        return Cancelled(
            "client: found it closed or restarted, or its tasks cancelled, expected it to run "
            "until they are done"
        )
    if isinstance(error, engine.KilledWorker):
        last = error.last_worker
        return ResourceError(
            f"client: found {error.allowed_failures + 1} workers to end in the middle of one task, "
            f"the last of them {last.name} ({last.address}), expected one that bears it: see the "
            "workers' logs, their memory limits, and memory="
        )
    return None
