"""From a lab's recording to a session in the browser: dropped, mapped, laid, corrected, checked and kept."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daq.lab.drafts import posture_of
from daq.sessions import read_yaml
from tests.browser.pages import Watched, require_browser, served, violations
from tests.server.lab import POSTURE, lab_files

require_browser()


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("service")) as (address, _):
        yield address


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lab_files(tmp_path_factory.mktemp("lab"))


DROP = """([text, name]) => {
  const carried = new DataTransfer();
  carried.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], name));
  document.querySelector('.drop').dispatchEvent(new DragEvent('drop', { dataTransfer: carried, bubbles: true }));
}"""


def dropped(page: Any, file: Path) -> None:
    import base64

    page.evaluate(DROP, [base64.b64encode(file.read_bytes()).decode(), file.name])


def test_a_dropped_recording_becomes_a_session(seen: Watched, lab: Path, tmp_path: Path) -> None:
    from playwright.sync_api import expect

    page = seen.page
    seen.open("", "Sessions")
    dropped(page, lab / "rig.csv")
    page.get_by_role("heading", level=1, name="New session from a recording").wait_for()
    confirm = page.get_by_role("button", name="That is right")
    confirm.wait_for()
    seen.drawn()
    assert page.get_by_label("Channel of Fx").input_value() == "Kraft x [N]"
    # A unit is asked for, never assumed.
    page.get_by_label("Unit of Fx").fill("")
    confirm.click()
    page.get_by_role("alert").filter(has_text="Fx has no unit").wait_for()
    page.get_by_label("Unit of Fx").fill("N")
    confirm.click()
    with page.expect_download() as kept:
        page.get_by_role("link", name="Save the mapping").click()
    assert '"confirmed": true' in Path(kept.value.path()).read_text("utf-8")
    page.get_by_label("Typed or pasted").fill((lab / "notes.txt").read_text("utf-8"))
    page.get_by_role("button", name="Lay onto the plateaus").click()
    page.get_by_text("17 plateaus; 0 to be looked at").wait_for()
    seen.drawn(2)
    # A gap puts what follows one later, and a choice puts one right again.
    page.get_by_role("button", name=re.compile("A gap at plateau 16")).click()
    assert page.get_by_label("Plateau 16 is").input_value() == "skip"
    assert page.get_by_label("Plateau 17 is").input_value() == "14"
    page.get_by_text("Line 16 of the notebook is on no plateau").wait_for()
    page.get_by_label("Plateau 16 is").select_option("14")
    page.get_by_label("Plateau 17 is").select_option("15")
    first = page.get_by_label("Plateau 2 is").input_value(), page.get_by_label("Plateau 3 is").input_value()
    for _ in range(2):
        page.locator(".grip").nth(1).drag_to(page.locator("tbody tr", has=page.get_by_label("Plateau 3 is")))
        first = first[::-1]
        now = page.get_by_label("Plateau 2 is").input_value(), page.get_by_label("Plateau 3 is").input_value()
        assert now == first
    for joint, angle in posture_of(POSTURE)[1].items():
        page.get_by_label(f"{joint} of minor_flexion [deg]").fill(f"{angle:g}")
    page.get_by_label("Name of the session").fill("monday")
    page.get_by_role("button", name="Check it").click()
    page.get_by_role("alert").filter(has_text="specimen").wait_for()
    page.get_by_label("Specimen", exact=True).fill("S01")
    page.get_by_label("Side of the hand").select_option("left")
    # Never by itself: a factor of the rig's own data is a choice.
    expect(page.get_by_label("Friction: a factor, or estimate")).to_have_value("")
    page.get_by_label("Friction: a factor, or estimate").fill(f"{read_yaml(lab / 'setup.yaml')['tension_factor']}")
    page.get_by_role("button", name="Check it").click()
    page.get_by_text("16 load cases; sound.").wait_for()
    page.get_by_text("Every case looks like what was hung").wait_for()
    assert violations(page) == []
    page.screenshot(path=str(tmp_path / "new.png"), full_page=True)
    page.get_by_role("button", name="Make the session").click()
    page.get_by_text("monday is here: 16 load cases measured.").wait_for()
    page.get_by_role("link", name="Compare it").click()
    page.get_by_role("heading", level=1, name="monday: predicted against measured").wait_for()
    seen.drawn()
    # The next run of the rig is mapped as this one.
    seen.open("new", "New session from a recording")
    page.get_by_label("Recordings", exact=True).set_input_files([lab / "rig.csv"])
    page.get_by_label("As in an earlier session").select_option("monday")
    page.get_by_text("By the saved mapping").wait_for()
    page.get_by_role("button", name="That is right").click()
    page.get_by_label("Specimen", exact=True).wait_for()
    expect(page.get_by_label("Specimen", exact=True)).to_have_value("S01")


def test_what_no_name_tells_is_chosen_by_hand_and_counted_at_a_rate(seen: Watched, lab: Path, tmp_path: Path) -> None:
    """Six names that tell nothing, no units, no time."""
    rows = [line.split(";")[1:] for line in (lab / "rig.csv").read_text("cp1252").splitlines()[1:400]]
    rows[0] = [f"Kanal {x}" for x in "abcdef"]
    recording = tmp_path / "run.csv"
    recording.write_text("\n".join(";".join(row) for row in rows) + "\n", "utf-8")
    page = seen.page
    seen.open("new", "New session from a recording")
    page.get_by_label("Recordings", exact=True).set_input_files([recording])
    confirm = page.get_by_role("button", name="That is right")
    confirm.click()
    page.get_by_role("alert").filter(has_text="give the sampling rate").wait_for()
    page.get_by_label("Sampling rate [Hz]").fill("25")
    confirm.click()
    page.get_by_role("alert").filter(has_text="Fx has no unit").wait_for()
    assert page.get_by_label("Channel of Tz").input_value() == "Kanal f"
    for axis, unit in (("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Tx", "N-m"), ("Ty", "N-m"), ("Tz", "N-m")):
        page.get_by_label(f"Unit of {axis}", exact=True).fill(unit)
    confirm.click()
    page.get_by_label("Typed or pasted").fill("RI 260, minor_flexion, tip\nRI 650")
    page.get_by_role("button", name="Lay onto the plateaus").click()
    page.get_by_text(re.compile(r"^\d plateaus; ")).wait_for()
    assert page.get_by_label("Plateau 2 is").input_value() == "0"


def test_a_file_of_another_kind_is_refused_in_words(seen: Watched, tmp_path: Path) -> None:
    photo = tmp_path / "photo.png"
    photo.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(200))
    seen.open("new", "New session from a recording")
    seen.page.get_by_label("Recordings", exact=True).set_input_files([photo])
    seen.page.get_by_role("alert").filter(has_text="photo.png").wait_for()
    seen.page.get_by_role("button", name="Leave photo.png out").click()
    seen.page.get_by_role("alert").filter(has_text="photo.png").wait_for(state="detached")
    seen.complaints = [c for c in seen.complaints if "422" not in c]
