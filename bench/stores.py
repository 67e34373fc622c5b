"""Standard scenes as stores, made by the command line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

#: The order of the store that a refinement is measured on.
ORDERS = {"base": "given", "sg": "given", "sgb": "given", "tree": "spatial"}


def made(scene: str, size: int, folder: Path, order: str = "given") -> Path:
    """A standard scene as a store; mount has the noise that the paper used."""
    store = folder / f"{scene}{size}.{order}.bfrt"
    options = ["--hash", "jenkins"] if scene == "mount" else []
    command = [sys.executable, "-m", "bfrt", "spd", scene, str(size), "-o", str(store)]
    subprocess.run([*command, *options, "--order", order, "--quiet"], check=True)
    return store
