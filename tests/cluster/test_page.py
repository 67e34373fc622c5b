"""The page about clusters, line by line: its blocks run as they are printed."""

from __future__ import annotations

import dataclasses
import inspect
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from cluster_fixtures import NEEDED, assert_same_picture

import bfrt
from bfrt.cli import parser

distributed = pytest.importorskip("distributed", reason=NEEDED)
dask = pytest.importorskip("dask", reason=NEEDED)

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "cluster.rst").read_text()
BLOCKS = [
    textwrap.dedent(block)
    for block in re.findall(r"\.\. code-block:: python\n\n((?:   .*\n|\n)+)", PAGE)
]


def block_of(*words):
    """The only block that has all these words."""
    (found,) = (block for block in BLOCKS if all(word in block for word in words))
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A fresh folder with what the page's second line makes, but smaller, as the current one."""
    (line,) = re.findall(r"\$ bfrt (spd .*)", PAGE)
    asked = parser().parse_args(line.split())
    recipe = bfrt.spd.scene(asked.name, 2)
    recipe.camera = dataclasses.replace(recipe.camera, resolution=(40, 40))
    recipe.write(tmp_path / asked.output)
    monkeypatch.setenv("PYTHONPATH", str(Path(bfrt.__file__).parents[1]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_block_is_tried():
    assert len(BLOCKS) == 6


def test_a_script(folder):
    (folder / "render.py").write_text(block_of("__main__"))
    done = subprocess.run(
        [sys.executable, "render.py"], check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    bfrt.open("scene.bfrt").render().save("here.png")
    assert Path("scene.png").read_bytes() == Path("here.png").read_bytes()


def test_lines_that_are_typed(folder, shared_client, capsys):
    """Those about rays, then counters, then copies, which go elsewhere."""
    typed = {"bfrt": bfrt, "client": shared_client, "scene": bfrt.open("scene.bfrt")}
    exec(block_of("da.from_zarr"), typed)
    hits, dark = typed["hits"], typed["dark"]
    assert hits["t_hit"].shape == (40_000,) and hits.stats.total.rays.eye == 40_000
    assert 0 < dark["occluded"].sum() < 40_000
    with dask.config.set(scheduler="synchronous"):
        exec(block_of("image.stats"), typed)
    assert len(capsys.readouterr().out.splitlines()) == len(shared_client.nthreads())
    (folder / "scratch").mkdir()
    copies = block_of("bfrt.copy_store").replace("/shared", ".").replace("/scratch", "scratch")
    exec(copies.replace('"./', f'"{folder}/').replace('"scratch/', f'"{folder}/scratch/'), typed)
    assert typed["scene"].path == folder / "scratch" / "scene.bfrt"
    assert_same_picture(typed["scene"].render(), bfrt.open("scene.bfrt").render())


def ran_elsewhere(block, folder, client):
    """The picture that a block about a cluster makes, by the workers that there are."""
    for printed, here in (
        ("/shared", str(folder)),
        ("/scratch", str(folder)),
        ('memory="32GiB"', 'memory="128MiB"'),
        ('memory="60GB"', 'memory="128MiB"'),
        ("= Client(cluster)", "= workers"),
        ("wait_for_workers(8)", "wait_for_workers(2)"),
    ):
        block = block.replace(printed, here)
    typed = {"workers": client}
    exec(block, typed)
    assert_same_picture(typed["image"], bfrt.open("scene.bfrt").render())


def test_machines_that_ssh_reaches(folder, shared_client, monkeypatch):
    """No machine is reached here: what the cluster is told is held against what it takes."""
    taken = inspect.signature(distributed.SSHCluster)
    options = inspect.signature(distributed.Nanny).parameters
    told = []

    def started(*args, **kwargs):
        told.append(taken.bind(*args, **kwargs).arguments)

    monkeypatch.setattr(distributed, "SSHCluster", started)
    ran_elsewhere(block_of("SSHCluster"), folder, shared_client)
    assert len(told[0]["hosts"]) == 3 and told[0]["worker_options"].keys() <= options.keys()


def test_jobs(folder, shared_client, monkeypatch):
    """No job is queued here, but its script is looked at."""
    queued = pytest.importorskip("dask_jobqueue", reason="needs dask-jobqueue")
    scripts = []
    monkeypatch.setattr(
        queued.SLURMCluster, "scale", lambda own, jobs: scripts.append((jobs, own.job_script()))
    )
    ran_elsewhere(block_of("SLURMCluster"), folder, shared_client)
    ((jobs, script),) = scripts
    assert jobs == 8 and "#SBATCH -p normal" in script and "#SBATCH -t 02:00:00" in script
    assert "--nthreads 32" in script and "--local-directory $TMPDIR" in script
    assert "--nworkers" not in script
