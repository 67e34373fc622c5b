"""A standard scene in spatial order keeps to its budget, and says which it takes."""

import re

import pytest

import bfrt
from bfrt.cli import main


def test_the_least_that_is_named_works(tmp_path):
    scene = bfrt.spd.tetra(6)
    with pytest.raises(bfrt.BudgetError) as refused:
        scene.write(tmp_path / "a.bfrt", order="spatial", memory=1)
    assert not (tmp_path / "a.bfrt").exists()
    least = re.search(r"expected (\d+MiB) or more", str(refused.value))[1]
    assert scene.write(tmp_path / "a.bfrt", order="spatial", memory=least).objects == 4**6
    assert scene.write(tmp_path / "b.bfrt", memory=1).objects == 4**6


def test_the_command_takes_a_budget(tmp_path, capsys):
    command = ["spd", "tetra", "6", "--order", "spatial", "-o", str(tmp_path / "a.bfrt")]
    assert main([*command, "--memory", "1MiB"]) == 2
    assert "memory: found 1MiB, expected" in capsys.readouterr().err
    assert main([*command, "--memory", "256MiB"]) == 0
