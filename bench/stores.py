"""Standard scenes as stores, made by the command line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def made(scene: str, size: int, folder: Path) -> Path:
    """A standard scene as a store; mount has the noise that the paper used."""
    store = folder / f"{scene}{size}.bfrt"
    options = ["--hash", "jenkins"] if scene == "mount" else []
    command = [sys.executable, "-m", "bfrt", "spd", scene, str(size), "-o", str(store), "--quiet"]
    subprocess.run([*command, *options], check=True)
    return store
