"""`fingertwin export --format osim|mjcf` and `fingertwin import` of such files, as their users meet them."""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fingermodel.fingers.files import finger_names, read_finger
from fingermodel.model_files import read_revision
from server import cli
from tests.fingermodel.exchanged import shared_fingers

ENDING = {"osim": ".osim", "mjcf": ".xml"}


def run(*arguments: object) -> tuple[int, str, str]:
    """Run the command line in this process: exit code, standard output, standard error."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        patch.setattr(sys, "argv", ["fingertwin", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            cli.main()
    return int(left.value.code or 0), out.getvalue(), err.getvalue()


def answered(*arguments: object) -> dict[str, Any]:
    code, out, err = run(*arguments, "--json", "-")
    assert (code, err) == (0, "")
    body: dict[str, Any] = json.loads(out)
    return body


def refused(*arguments: object) -> str:
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize("kind", ENDING)
@pytest.mark.parametrize("name", finger_names())
def test_every_shipped_finger_goes_out_and_comes_back(name: str, kind: str, tmp_path: Path) -> None:
    file = tmp_path / f"out{ENDING[kind]}"
    body = answered("export", name, "--format", kind, "--out", file)
    assert (body["schema"], body["file"]) == ("fingertwin/export/1", str(file))
    elastic = any("elastic hood" in note for note in body["notes"])
    assert elastic == (name not in shared_fingers())
    assert len(body["notes"]) == 1 + elastic
    ET.parse(file)  # noqa: S314 - our own
    back = answered("import", file, "--out", tmp_path / "back.yaml")
    assert (back["schema"], back["id"], back["notes"]) == ("fingertwin/import/1", name, [])
    assert read_finger(tmp_path / "back.yaml").topology == read_finger(name).topology


def test_an_export_without_a_name_stays_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _ = run("export", "an1979_middle", "--format", "mjcf")
    assert code == 0
    assert [p.name for p in tmp_path.iterdir()] == ["an1979_middle.xml"]
    note, file = out.splitlines()
    assert note.startswith("MJCF cannot hold the resting line of PIP.ES")
    assert file == "an1979_middle.xml"


@pytest.fixture(scope="module")
def revision(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("models") / "r1.json"
    assert run("refit", "synek2019_H01", "--out", path)[0] == 0
    return path


def test_a_revision_goes_out_with_its_fitted_finger(revision: Path, tmp_path: Path) -> None:
    for kind, ending in ENDING.items():
        answered("export", revision, "--format", kind, "--out", tmp_path / f"r1{ending}")
        answered("import", tmp_path / f"r1{ending}", "--out", tmp_path / f"{kind}.yaml")
        fitted, again = read_revision(revision).finger, read_finger(tmp_path / f"{kind}.yaml")
        assert again.topology == fitted.topology
        assert_allclose(again.values.fraction, fitted.values.fraction, rtol=0, atol=1e-15)
        straight = [i for i, s in enumerate(fitted.topology.segments) if s.wrap == "straight"]
        ends = np.asarray(fitted.values.proximal_point)[straight]
        assert_allclose(np.asarray(again.values.proximal_point)[straight], ends, rtol=0, atol=1e-12)


def test_effects_of_a_revision_are_said_to_stay_behind(revision: Path, tmp_path: Path) -> None:
    document = json.loads(revision.read_text(encoding="utf-8"))
    document["effects"] = [{"name": "rig_friction", "parameters": ["rig_friction"], "document": None}]
    (tmp_path / "r2.json").write_text(json.dumps(document), encoding="utf-8")
    notes = answered("export", tmp_path / "r2.json", "--format", "osim", "--out", tmp_path / "r1.osim")["notes"]
    assert notes[0] == "The file holds the fitted finger without the revision's effects: rig_friction"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["export", "synek2019_H01", "--format", "osim"], "no finger 'synek2019_H01'"),
        (["export", "absent.json", "--format", "mjcf"], "no model file absent.json"),
        (["export", "an1979_middle", "--format", "osim", "--out", "x.xml"], "expected a name that ends in .osim"),
        (["export", "an1979_middle", "--format", "mjcf", "--model", "x"], "expected the finger alone"),
        (["export", "an1979_middle", "--format", "osim", "--out", "/proc/x/y.osim"], "cannot be written"),
        (["import", "absent.osim"], "absent.osim cannot be read (No such file or directory)"),
        (["import", "absent.xml", "--map", "x"], "--map or --calibration with a finger"),
        (["import", "absent.xml", "--out", "x.parquet"], "expected a name that ends in .yaml"),
        (["import", "absent.tdms", "--load-point", "0 0 0"], "--load-point with absent.tdms"),
        (["import", "absent.osim", "--load-point", "0 0"], "--load-point is '0 0'; expected 3 numbers"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused(*arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_finger_file_is_not_written_over(tmp_path: Path) -> None:
    answered("export", "an1979_middle", "--format", "osim", "--out", tmp_path / "a.osim")
    mine = tmp_path / "mine.yaml"
    mine.write_text("kept", encoding="utf-8")
    assert "mine.yaml exists" in refused("import", tmp_path / "a.osim", "--out", mine)
    assert mine.read_text(encoding="utf-8") == "kept"
