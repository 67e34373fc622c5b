"""What a scene shows of itself in a notebook: a table of what it holds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from bfrt.image.color_scale import ColorScale
from bfrt.store.extent import Bounds
from bfrt.store.store import Store

Rows = Sequence[tuple[str, ...]]

STYLE = "text-align: left"


def html_of(store: Store) -> str:
    """Return what a store holds, as HTML: kinds, counts, bounds, order and bytes."""
    streams = [
        (
            str(stream.group),
            stream.kind.label,
            f"{stream.count:,}",
            "float64" if stream.wide else "float32",
            "spatial" if stream.ordered else "given",
            f"{sum(facts.bytes for facts in stream.files.values()):,}",
        )
        for stream in store.streams
    ]
    facts = [
        ("objects", f"{store.objects:,}"),
        ("bytes", f"{store.bytes:,}"),
        *bounds_rows(store.world_bounds),
        ("camera", "its own" if store.camera else "none: it is framed"),
        ("lights", f"{len(store.lights):,}" if store.lights else "none: it is lit"),
        *([("reference system", store.crs)] if store.crs else []),
        *color_rows(store.colors),
    ]
    head = ("group", "kind", "objects", "dtype", "order", "bytes")
    return f"<b>{escape(str(store.path))}</b>{table(facts)}{table([head, *streams])}"


def bounds_rows(bounds: Bounds) -> Rows:
    """Return the rows of a box: none where there are no objects."""
    if bounds.empty:
        return [("bounds", "none")]
    return [
        (name, " ".join(f"{float(x):.12g}" for x in corner))
        for name, corner in (("least", bounds.lo), ("greatest", bounds.hi))
    ]


def color_rows(colors: Iterable[ColorScale]) -> Rows:
    """Return a row for each scale of colors."""
    return [("colors", f"{c.name}: {c.lo:g} to {c.hi:g}, {c.colormap}") for c in colors]


def table(rows: Iterable[tuple[str, ...]]) -> str:
    """Return rows as a table of HTML."""
    lines = ("".join(f'<td style="{STYLE}">{escape(cell)}</td>' for cell in row) for row in rows)
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"
