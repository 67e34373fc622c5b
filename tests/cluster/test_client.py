"""Which client is meant, and what is said where there is none, or no Dask."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import tempfile

import pytest
from cluster_fixtures import MEMORY, NEEDED, cluster_of
from sharded_scenes import both, rays

import bfrt
from bfrt.errors import SettingError


@pytest.fixture
def scene(paths):
    with bfrt.open(paths["spatial"]) as opened:
        yield opened


def test_an_absent_extra(scene, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SettingError) as caught:
        scene.render(client=True)
    assert str(caught.value) == "client: a cluster needs Dask: pip install bfrt[dask]"


def test_plain_use_imports_no_dask():
    code = """
import sys, bfrt, numpy as np
with bfrt.SceneWriter(sys.argv[1], durable=False) as writer:
    writer.spheres([[0.0, 0, 0]], [1.0])
scene = bfrt.open(sys.argv[1])
scene.render(memory="128MiB", camera=scene.framing_camera(resolution=(4, 4)))
scene.cast_rays(np.zeros((1, 3)), np.ones((1, 3)))
print([name for name in sys.modules if name.split(".")[0] in ("dask", "distributed")])
"""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", code, f"{folder}/x.bfrt"]
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_no_current_client(scene, monkeypatch):
    distributed = pytest.importorskip("distributed", reason=NEEDED)

    def none():
        raise ValueError("No clients found")

    monkeypatch.setattr(distributed, "default_client", none)
    with pytest.raises(SettingError, match="client: found no current client, expected one, as"):
        scene.render(client=True)


@pytest.mark.parametrize("client", ["tcp://127.0.0.1:8786", 4])
def test_what_is_no_client(scene, client):
    pytest.importorskip("distributed", reason=NEEDED)
    with pytest.raises(SettingError, match=r"client: found \w+, expected a dask.distributed.Clie"):
        scene.render(client=client)


@pytest.mark.parametrize("client", [None, False])
def test_no_client_is_asked_for(scene, client):
    image = scene.render(memory=MEMORY, client=client)
    assert type(image.stats) is bfrt.stats.Stats


def test_a_client_that_is_closed(scene):
    with cluster_of(1, processes=False) as client:
        with pytest.raises(SettingError, match="checkpoint: found one with a client, expected No"):
            scene.render(client=client, checkpoint="x")
        client.close()
        with pytest.raises(SettingError, match="client: found one that is closed, expected one th"):
            scene.render(client=client)


def test_a_client_that_is_asynchronous(scene):
    distributed = pytest.importorskip("distributed", reason=NEEDED)

    async def ask():
        settings = {"n_workers": 1, "processes": False, "dashboard_address": ":0"}
        async with distributed.Client(asynchronous=True, **settings) as client:
            with pytest.raises(SettingError, match="client: found an asynchronous one, expected"):
                scene.render(client=client)

    asyncio.run(ask())


def test_a_scene_whose_client_is_closed(tmp_path):
    """It has it from the day that it was opened."""
    pytest.importorskip("distributed", reason=NEEDED)
    sharded = both(tmp_path, 2).sharded
    with cluster_of(1, processes=False) as client:
        far = bfrt.open(sharded.path, client=client)
        client.close()
        for ask in (far.render, lambda: far.cast_rays(*rays(3)), lambda: far.occluded(*rays(3))):
            with pytest.raises(
                SettingError, match="client: found one that is closed, expected one"
            ):
                ask()
