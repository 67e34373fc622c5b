"""JSON files that are whole at any moment: written beside, and renamed."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any


def save(path: Path | None, found: Any) -> None:
    """Write what was found, in place of what the file had; nothing without a path."""
    if path is None:
        return
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(json.dumps(found, indent=1) + "\n")
    beside.replace(path)
