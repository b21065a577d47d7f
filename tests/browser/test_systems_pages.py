"""Fingers, forces inside them and published studies, as a user meets them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.locations import data_dir
from fingermodel.fingers.files import read_finger
from tests.browser.pages import Watched, require_browser, served, violations

require_browser()

SESSION = "DEV-01"


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    from fingertwin.client import Client

    with served(tmp_path_factory.mktemp("service")) as (address, _):
        with Client(address) as twin:
            twin.upload(SESSION)
        yield address


def picked(seen: Watched, finger: str) -> None:
    seen.open("fingers", "Fingers")
    seen.page.get_by_role("button", name=finger, exact=True).click()
    seen.page.get_by_role("heading", level=2, name=read_finger(finger).title).wait_for()


def test_a_finger_is_looked_at_and_taken_along(seen: Watched) -> None:
    picked(seen, "synek2019_optimised")
    assert "FunctionBasedPath" in seen.text()
    with seen.page.expect_download() as found:
        seen.page.get_by_role("link", name="OpenSim (.osim)").click()
    file = Path(found.value.path())
    assert found.value.suggested_filename == "synek2019_optimised.osim"
    # It comes back by the same page.
    seen.page.get_by_label("An .osim or MJCF .xml file").set_input_files(
        {"name": "theirs.osim", "mimeType": "application/xml", "buffer": file.read_bytes()}
    )
    seen.page.get_by_text(re.compile(r"theirs.osim: 4 bones")).wait_for()
    with seen.page.expect_download() as back:
        seen.page.get_by_role("link", name="Save as a finger file").click()
    assert back.value.suggested_filename == "theirs.yaml"
    assert violations(seen.page) == []


def test_what_is_no_finger_is_said(seen: Watched) -> None:
    seen.open("fingers", "Fingers")
    seen.page.get_by_label("An .osim or MJCF .xml file").set_input_files(
        {"name": "theirs.osim", "mimeType": "application/xml", "buffer": b"nothing"}
    )
    alert = seen.page.get_by_role("alert").filter(has_text="is not XML")
    alert.wait_for()
    assert "\n" not in alert.inner_text()
    seen.complaints = [c for c in seen.complaints if "422" not in c]


def test_a_finger_is_compared_moved_activated_and_scaled(seen: Watched) -> None:
    picked(seen, "synek2019_optimised")
    seen.page.get_by_role("button", name="Compare", exact=True).click()
    seen.drawn()
    seen.page.get_by_text("Bone lengths and mean flexion moment arms").last.wait_for()
    seen.page.get_by_label("PP [mm]").fill("0.04")
    seen.page.get_by_role("button", name="Scale", exact=True).click()
    seen.page.get_by_role("alert").filter(has_text="0.04").wait_for()
    seen.page.get_by_label("PP [mm]").fill("40")
    seen.page.get_by_role("button", name="Scale", exact=True).click()
    seen.page.get_by_role("link", name="Save as a finger file").wait_for()
    picked(seen, "wu2008_index")
    seen.page.get_by_role("button", name="Work it out").click()
    seen.page.get_by_text("Peaks in wu2008_tap").wait_for()
    seen.drawn(2)
    picked(seen, "barry2018_index")
    seen.page.get_by_label("Muscle that loses activation").select_option("FDP")
    seen.page.get_by_role("button", name="Activate all muscles").click()
    seen.page.get_by_text("With 50 % of FDP lost").wait_for()
    seen.drawn(2)
    assert violations(seen.page) == []
    seen.complaints = [c for c in seen.complaints if "422" not in c]


def test_forces_inside_the_finger_stand_beside_what_hung(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/forces", f"{SESSION}: forces inside the finger")
    seen.drawn(2)
    assert re.search(r"In \d+ of \d+ cases the load that really hung is found", seen.text())
    assert violations(seen.page) == []
    seen.page.get_by_label("What settles it").select_option("minimal")
    seen.page.get_by_text(re.compile("four muscles")).last.wait_for()
    seen.drawn(2)
    seen.page.get_by_label("Model", exact=True).select_option("wu2008_index")
    seen.page.get_by_role("alert").filter(has_text="loads EDC").wait_for()
    seen.complaints = [c for c in seen.complaints if "422" not in c]


def test_a_published_study_is_computed(seen: Watched) -> None:
    seen.open("studies", "Published studies")
    seen.page.get_by_role("button", name=re.compile("Wu et al. 2008")).click()
    seen.page.get_by_text("It was not computed on this service yet.").wait_for()
    seen.page.get_by_role("button", name="Compute it").click()
    seen.page.get_by_text(re.compile(r"\d+ of \d+ figures that can be recomputed agree")).wait_for(timeout=240_000)
    seen.drawn()
    assert violations(seen.page) == []


def test_every_shipped_finger_opens(seen: Watched) -> None:
    for path in sorted((data_dir() / "fingers").glob("*.yaml")):
        picked(seen, path.stem)
        assert "Tendon points" in seen.text()
