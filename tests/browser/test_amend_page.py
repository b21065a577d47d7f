"""A slip of the pen on the pages: the suspect is named, amended with a reason, seen everywhere, and taken back."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from daq.locations import data_dir
from fingertwin.client import Client
from tests.browser.pages import Watched, require_browser, served

require_browser()

SESSION = "DEV-02"
OUTDATED = "The session was changed since this search: search again."
WHY = "the photo shows the suture of FDS"


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service with a session in which one tendon's name is another's."""
    folder = tmp_path_factory.mktemp("sessions") / SESSION
    shutil.copytree(data_dir() / "sessions" / SESSION, folder)
    file = folder / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    case = next(c for c in document["cases"] if c["id"] == "c010")
    case["masses_g"] = {"FDP": case["masses_g"]["FDS"]}
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    with served(tmp_path_factory.mktemp("service")) as (address, _):
        with Client(address) as twin:
            twin.upload(folder)
        yield address


def test_a_suspect_is_amended_with_the_users_reason_and_taken_back(seen: Watched, tmp_path: Path) -> None:
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.page.get_by_role("button", name="Find the missing effect").click()
    seen.page.get_by_role("heading", name="Suspect load cases").wait_for(timeout=240_000)
    assert "FDS was loaded, not FDP" in seen.text()
    assert "Found: the hanger was not weighed" in seen.text()
    seen.page.screenshot(path=tmp_path / "suspect.png", full_page=True)
    amend = seen.page.get_by_role("button", name="c010: amend, FDS was loaded, not FDP")
    amend.click()
    # How one knows is the user's to say: without it, nothing is amended.
    form = seen.page.get_by_role("form", name="c010: amend, FDS was loaded, not FDP")
    form.get_by_role("button", name="Amend").click()
    why = form.get_by_label("Amend, because")
    assert why.evaluate("field => !field.validity.valid && field === document.activeElement")
    form.get_by_role("button", name="Cancel").click()
    amend.click()
    seen.page.screenshot(path=tmp_path / "reason.png", full_page=True)
    why.fill(WHY)
    form.get_by_role("button", name="Amend").click()
    seen.page.get_by_text("c010 is amended: FDS was loaded, not FDP").wait_for()
    # The search tells of the session as it was: page and report say so, and nothing is amended twice.
    seen.page.get_by_text(OUTDATED).wait_for()
    amend.wait_for()
    assert amend.is_disabled()
    seen.open(f"sessions/{SESSION}/report", f"{SESSION}: report")
    seen.page.get_by_text(OUTDATED).wait_for()
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.page.get_by_text(OUTDATED).wait_for()
    assert amend.is_disabled()
    seen.open(f"sessions/{SESSION}/compare?case=c010", f"{SESSION}: predicted against measured")
    seen.page.get_by_text("c010 is amended: FDS 950 g hung").wait_for()
    seen.page.get_by_text(f"Amended (entered: FDP 950 g): {WHY}").wait_for()
    seen.page.screenshot(path=tmp_path / "amended.png", full_page=True)
    seen.page.get_by_role("button", name="Undo: c010 amended").click()
    seen.page.get_by_text("c010 is amended: FDS 950 g hung").wait_for(state="detached")
    # With the amendment taken back, the search is of the session as it is.
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.drawn()
    assert amend.is_enabled()
    assert OUTDATED not in seen.text()
    # Somebody else leaves a case out.
    with Client(seen.url) as twin:
        twin.session(SESSION).exclude("c012", "the suture slipped")
    seen.page.get_by_text(OUTDATED).wait_for()
    assert amend.is_enabled()
