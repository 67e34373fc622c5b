"""The report of all benchmarks: its cases, how it goes on, and the page that it makes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="the bench extra is not installed")

import report
from compare import history
from reporting import machine, running
from reporting.cases import CASES, SIZES, Case, cases_of
from reporting.flat import rows_of
from reporting.kinds import KINDS, key_of
from reporting.page import write_page
from reporting.record import Record
from reporting.sections import SECTIONS, part_of
from reporting.summary import lines_of
from reporting.tables import number, table

ROOT = Path(__file__).resolve().parents[1]
HISTORY = sorted((ROOT / "bench" / "history").glob("*.json"))
PAGE = ROOT / "docs" / "performance"

FACTS = {"version": "1", "revision": "abc", "machine": {"cores": 2}, "programs": {}}

#: A script that writes rows, counts its runs, and fails the first time where it is told to.
SCRIPT = """
import json, sys
from pathlib import Path
here = Path(__file__).parent
runs = here / f"{sys.argv[2]}.runs"
runs.write_text(str(int(runs.read_text() if runs.exists() else 0) + 1))
if sys.argv[2] == "bad" and runs.read_text() == "1":
    sys.exit(3)
out = Path(sys.argv[sys.argv.index("--json") + 1])
out.write_text(json.dumps([{"kind": "sphere", "shape": sys.argv[2], "objects": 8,
                            "order": "spatial", "seconds": 1.0, "closing": 0.5}]))
"""


def test_a_case_is_named_once_and_its_script_is_there():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names) > 60
    assert {case.kind for case in CASES} == set(KINDS)
    assert all((ROOT / "bench" / case.words[0]).exists() for case in CASES)


def test_a_larger_size_has_all_of_a_smaller_one():
    quick, large, huge = (cases_of(size, []) for size in SIZES)
    assert set(quick) < set(large) < set(huge)
    assert {case.kind for case in cases_of("huge", ["billion"])} == {"billion"}


def test_every_kind_is_on_the_page():
    shown = {kind for section in SECTIONS.values() for kind in section.kinds + section.also}
    assert shown == set(KINDS)
    text = (ROOT / "docs" / "performance.rst").read_text()
    included = re.findall(r"^\.\. include:: performance/(\w+)\.rst$", text, re.MULTILINE)
    assert sorted(included) == sorted([*SECTIONS, "summary", "machine"])


@pytest.fixture
def probes(monkeypatch):
    made = []

    def probe(folder):
        made.append(folder)
        return {"time": machine.now(), "disk_write": 1e9, "disk_read": 1e9, "loop": 1, "loops": 1}

    monkeypatch.setattr(running, "probe", probe)
    return made


@pytest.fixture
def scripts(tmp_path, monkeypatch):
    folder = tmp_path / "scripts"
    folder.mkdir()
    (folder / "ordering.py").write_text(SCRIPT)
    monkeypatch.setattr(running, "BENCH", folder)
    return folder


def test_a_report_goes_on_where_it_ended(tmp_path, scripts, probes):
    path = tmp_path / "report.json"
    cases = [Case("ordering", f"sphere {shape}", "quick") for shape in ("good", "bad")]
    wrong = running.run_all(Record.begun(path, FACTS), cases, [], tmp_path)
    assert wrong == ["ordering.py sphere bad: exit status 3"]
    assert list(Record.read(path).cases) == ["ordering.py sphere good"]
    assert running.run_all(Record.begun(path, FACTS), cases, [], tmp_path) == []
    record = Record.read(path)
    assert [row["shape"] for row in record.rows("ordering")] == ["good", "bad"]
    assert [(scripts / f"{name}.runs").read_text() for name in ("good", "bad")] == ["1", "2"]
    assert len(record.found["probes"]) == len(probes) == 3  # the first, and one when each run ends
    assert sorted(path.parent.iterdir()) == sorted([path, scripts])  # nothing is left beside


@pytest.mark.parametrize("name", ["version", "revision", "machine"])
def test_a_report_is_of_one_version_on_one_machine(tmp_path, name):
    path = tmp_path / "report.json"
    Record.begun(path, FACTS).add("a", {"kind": "ordering", "time": "2026", "rows": []})
    with pytest.raises(SystemExit, match=f"is of {name} .*, expected other"):
        Record.begun(path, {**FACTS, name: "other"})


def test_what_is_no_report_is_refused(tmp_path):
    (tmp_path / "run.json").write_text(json.dumps({"benchmarks": []}))
    with pytest.raises(SystemExit, match=r"run\.json: is no report"):
        Record.read(tmp_path / "run.json")


@pytest.mark.parametrize("path", HISTORY, ids=lambda path: path.stem)
def test_a_page_is_made_of_each_report(tmp_path, path):
    record = Record.read(path)
    write_page(record, tmp_path)
    for name, section in SECTIONS.items():
        text = (tmp_path / f"{name}.rst").read_text()
        known = [kind for kind in section.kinds if kind in record.kinds()]
        if known and name != "slow_disk":
            assert "====" in text
        elif not known:
            assert "Not measured in this report; ``python bench/report.py --size" in text
            assert not (tmp_path / f"{name}.png").exists()
    assert len((tmp_path / "summary.rst").read_text().split("\n- ")) <= 11
    assert record.found["revision"] in (tmp_path / "machine.rst").read_text()


def test_the_page_is_what_its_report_makes(tmp_path):
    named = re.findall(r"from (\S+\.json)\.", (PAGE / "machine.rst").read_text())
    (path,) = [path for path in HISTORY if path.name in named]
    write_page(Record.read(path), tmp_path)
    names = sorted(file.name for file in PAGE.glob("*"))
    assert names == sorted(file.name for file in tmp_path.glob("*"))
    for file in PAGE.glob("*.rst"):
        assert file.read_text() == (tmp_path / file.name).read_text()


@pytest.mark.parametrize("path", HISTORY, ids=lambda path: path.stem)
def test_rows_are_told_apart_by_their_keys(path):
    record = Record.read(path)
    assert record.kinds()
    for kind in record.kinds():
        keys = [key_of(kind, row) for row in record.rows(kind)]
        assert len(set(keys)) == len(keys)


def test_what_a_script_writes_becomes_rows():
    each = {"tracing": 2.0, "preprocess": 1.0, "bytes": 5, "passes": 3}
    found = [{"scene": "rings:7", "making": {"sgb": 1.0, "tree": 2.0}, "sgb": each,
              "tree": {**each, "tracing": 1.0}, "bytes": {"sgb": 10, "tree": 20}}]  # fmt: skip
    rows = rows_of("tree", found)
    assert [(r["size"], r["refine"], r["tracing"], r["store_bytes"]) for r in rows] == [
        (7, "sgb", 2.0, 10),
        (7, "tree", 1.0, 20),
    ]


def test_a_table_has_no_column_of_dashes():
    made = table(["name", "s", "MiB"], [["a", number(1.234), "–"], ["b", number(None), "–"]])
    assert made.split("\n")[1:4] == ["name     s", "====  ====", "a     1.23"]


def test_history_tells_what_two_reports_have(tmp_path, capsys):
    assert history(HISTORY, tmp_path / "history.png") == 0
    said = capsys.readouterr().out
    assert re.search(
        r"^  1\.65  tracing      rings 36 .*27 1\.74 s .*29 4\.65 s .*30 2\.88 s$", said, re.M
    )
    assert (tmp_path / "history.png").stat().st_size > 1000
    assert history(HISTORY[:1], None) == 1


def test_the_command_makes_the_page_anew(tmp_path, monkeypatch):
    words = ["report.py", "--from", str(HISTORY[0]), "--page", str(tmp_path / "page")]
    monkeypatch.setattr("sys.argv", words)
    assert report.main() == 0
    assert (tmp_path / "page" / "memory.rst").exists()


@pytest.mark.parametrize("path", HISTORY, ids=lambda path: path.stem)
def test_a_page_can_be_made_of_any_one_case(path):
    record = Record.read(path)
    for name, case in record.cases.items():
        alone = Record(path, {**record.found, "cases": {name: case}})
        made = [section for section in SECTIONS if part_of(alone, section)]
        assert made or case["kind"] == "random"  # which is told beside others
        assert len(lines_of(alone)) <= 10
