"""A notebook is read as it was written, and laid onto the plateaus of a recording."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.errors import InputError
from daq.lab.drafts import cases_of, chosen, posture_of
from daq.lab.layout import Layout, lay
from daq.lab.levels import Level, find_levels
from daq.lab.notebook import Note, read_notes
from daq.recordings.readings import ReadingBlock

Floats = NDArray[np.float64]
TENDONS = ("FDP", "FDS", "EDC", "RI")


def test_a_line_says_what_hung_where_and_the_next_what_changes() -> None:
    notes = read_notes("# rig 7\nfdp 950, hook, tip\n0.3 kg\n".replace("0.3 kg", "FDS 0.3 kg, validation"), TENDONS)
    assert notes == (
        Note("load", 2, (("FDP", 950.0),), "hook", "tip"),
        Note("load", 3, (("FDS", 300.0),), "hook", "tip", "validation"),
    )
    notes = read_notes("FDP=300 + FDS: 200,5 g; major flexion; bone; x3\ntare\nagain\nskip", TENDONS)
    assert [n.kind for n in notes] == ["load"] * 3 + ["tare", "load", "skip"]
    assert notes[0].masses_g == (("FDP", 300.0), ("FDS", 200.5))
    assert [n.repeats for n in notes] == [False, True, True, False, True, False]
    assert (notes[4].posture, notes[4].location) == ("major flexion", "bone")


def test_how_a_weight_came_to_rest_is_of_its_own_line() -> None:
    text = "FDP 950, hook, tip\nFDP 950, unloading\nFDP 950, unloading, tapped\nFDS 300\n"
    notes = read_notes(text, TENDONS)
    said = [("loading", False), ("unloading", False), ("unloading", True), ("loading", False)]
    assert [(n.direction, n.tapped) for n in notes] == said
    table = read_notes("tendon,mass,posture,location,direction\nFDP,1,hook,tip,unloading\nFDP,2,,,\n", TENDONS)
    assert [n.direction for n in table] == ["unloading", "loading"]
    # A load case says the same.
    levels = recording(list(notes), True)
    cases = cases_of(levels, chosen(lay(levels, notes), notes))
    assert [(c.get("direction"), c.get("note")) for c in cases] == [
        (None, None), ("unloading", None), ("unloading", "tapped"), (None, None)
    ]  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        "tendon,mass,posture,location\nFDP,950,hook,tip\nEDC,400,hook,bone\n",
        "Tendon;Mass;Posture;Location\nFDP;950;hook;tip\nEDC;400,0;;bone\n",
        "FDP,EDC,posture,location\n950,,hook,tip\n0,400,hook,bone\n",
        "FDP 950, hook, tip\nEDC 400, bone\n",
    ],
)
def test_a_table_is_as_good_as_typed_lines(text: str) -> None:
    loads = [(n.masses_g, n.posture, n.location) for n in read_notes(text, TENDONS)]
    assert loads == [((("FDP", 950.0),), "hook", "tip"), ((("EDC", 400.0),), "hook", "bone")]


WIDE, LONG = "FDP,FDS,posture,location\n", "tendon,mass,posture,location\n"


def test_a_cell_of_a_tendon_is_a_mass_as_in_a_typed_line() -> None:
    notes = read_notes(WIDE + '950 g,0,hook,tip\n0.95 kg,,,\n"300,5",285 g,,bone\n,,,\n', TENDONS)
    hung = [n.masses_g for n in notes]
    assert hung == [(("FDP", 950.0),), (("FDP", 950.0),), (("FDP", 300.5), ("FDS", 285.0))]


@pytest.mark.parametrize(
    ("row", "posture"), [("0,0,flat,tip", "flat"), ("tare,,flat,tip", "flat"), ("tare,,,", "hook")]
)
def test_a_row_in_which_nothing_hangs_is_a_tare_and_not_the_load_before(row: str, posture: str) -> None:
    notes = read_notes(f"{WIDE}950,0,hook,tip\n{row}\n0,300,,\n", TENDONS)
    assert [(n.kind, n.masses_g) for n in notes] == [
        ("load", (("FDP", 950.0),)), ("tare", ()), ("load", (("FDS", 300.0),))
    ]  # fmt: skip
    assert notes[2].posture == posture


@pytest.mark.parametrize("heading", [WIDE, LONG])
@pytest.mark.parametrize("row", ["again,,,", ",,again,"])
def test_a_row_without_a_mass_is_the_load_before_where_it_says_so(heading: str, row: str) -> None:
    first = "950,0,hook,tip" if heading == WIDE else "FDP,950,hook,tip"
    notes = read_notes(f"{heading}{first}\n{row}\n", TENDONS)
    assert [(n.masses_g, n.posture, n.repeats) for n in notes] == [
        ((("FDP", 950.0),), "hook", False), ((("FDP", 950.0),), "hook", True)
    ]  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        f"{LONG}FDP,950,hook,tip\ntare,,,\nFDS,300,,\nskip,,,\n",
        f"{WIDE}950,0,hook,tip\ntare,,,\n,300,,\nskip,,,\n",
        "FDP 950, hook, tip\ntare\nFDS 300\nFDS 700, skip\n",
    ],
)
def test_tare_and_skip_are_no_postures(text: str) -> None:
    notes = read_notes(text, TENDONS)
    assert [n.kind for n in notes] == ["load", "tare", "load", "skip"]
    assert (notes[2].masses_g, notes[2].posture) == ((("FDS", 300.0),), "hook")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the notebook is empty"),
        (f"{WIDE}950,0,hook,tip\n0,n/a,,", "line 3 of the notebook, column FDS, has 'n/a'"),
        (f"{WIDE}9x50,0,hook,tip", "line 2 of the notebook, column FDP, has '9x50'"),
        (f"{WIDE}950,0,hook,tip\n,,flat,tip", "line 3 of the notebook, 'flat, tip', names no mass"),
        (f"{WIDE}950,5,0,hook,tip", "line 2 of the notebook has 'tip' behind its last column"),
        (f"{LONG}FDP,950,hook,tip\n,300,,", "line 3 of the notebook, column tendon, has '300'"),
        (f"{LONG}FDP,950,hook,tip\n,,,bone", "line 3 of the notebook, 'bone', names no mass"),
        ("FDP 950, hook, tip, tare", "is a tare with a mass"),
        ("FDP 285 + fdp 285, hook, bone", "line 1 of the notebook, 'FDP 285 + fdp 285, hook, bone', names FDP twice"),
        ("FDP 300, FDP 200, hook, bone", "names FDP twice"),
        ("FDP 950, hook, bone, tip", "line 1 of the notebook has 'bone' and 'tip'; expected one of them"),
        ("FDP 950, hook, minor, tip", "line 1 of the notebook has 'hook' and 'minor'"),
        ("FDP 950, hook, tip, unloading, loading", "line 1 of the notebook has 'unloading' and 'loading'"),
        (f"{LONG}FDP,950,tip,bone", "line 2 of the notebook has 'tip' and 'bone'"),
        ("FDP,FDS,FDP,posture,location\n1,2,3,hook,tip", "line 1 of the notebook has two columns of FDP"),
        ("hook, tip", "line 1 of the notebook, 'hook, tip', lacks a mass"),
        ("FDP 950, tip", "lacks a posture"),
        ("FDP 950, hook", "lacks tip or bone"),
        ("FDP 950, hook, tip\nFDP ?!, tip", "line 2 of the notebook has 'FDP ?!'"),
        ("tare\nskip", "names no load"),
        ("FDP 950, hook, tip\nFDP 300 hook", "line 2 of the notebook has 'FDP 300 hook'"),
        ("FDP 1, hook, tip, x99999999", "fewer repeats"),
    ],
)
def test_what_is_not_understood_is_said_with_its_line(text: str, said: str) -> None:
    with pytest.raises(InputError, match=None) as caught:
        read_notes(text, TENDONS)
    assert said in str(caught.value)


def test_a_posture_by_its_angles() -> None:
    assert posture_of("hook: MCP 0, PIP=65 DIP -5.5") == ("hook", {"MCP": 0.0, "PIP": 65.0, "DIP": -5.5})
    for text in ("hook", "hook: ", ": MCP 1", "hook: MCP x"):
        with pytest.raises(InputError, match="a name and angles"):
            posture_of(text)
    assert posture_of("bent: MCP2 10")[1] == {"MCP2": 10.0}
    for text, said in (("MCP 0 PIP 65", "posture hook lacks DIP"), ("MCP 0 PIP 650 DIP 50", "posture hook.PIP is 650")):
        with pytest.raises(InputError, match=said):
            posture_of(f"hook: {text}")


# A rig whose force is the masses' by a matrix of its own for each block, tares that differ from block to block, noise.


def recording(notes: list[Note], between: bool, also: tuple[int, ...] = (), seed: int = 3) -> list[Level]:
    """Plateaus of a recording, `also` a second plateau behind these lines of which nobody wrote."""
    rng = np.random.default_rng(seed)
    arms: dict[object, Floats] = {}
    base: dict[object, Floats] = {}
    values: list[Floats] = []
    last: object = None
    for i, note in enumerate(notes):
        if note.block not in base:
            base[note.block] = rng.normal(0.0, [2, 2, 2, 20, 20, 20])
            arms[note.block] = rng.normal(0.0, [2e-3, 2e-3, 2e-3, 0.02, 0.02, 0.02], (len(TENDONS), 6))
        tare = base[note.block] + rng.normal(0.0, [0.01, 0.01, 0.01, 0.1, 0.1, 0.1])
        if between or note.block != last:
            values.append(tare)
        last = note.block
        hung = np.array([dict(note.masses_g).get(name, 0.0) for name in TENDONS])
        for _ in range(1 + (i in also)):
            values.append(base[note.block] + hung @ arms[note.block])
            if i in also:
                hung = hung + 250.0
    t_s = np.arange(0.0, 4.0 * len(values), 0.05)
    wrench = np.array(values)[np.minimum((t_s // 4.0).astype(int), len(values) - 1)]
    noise = rng.normal(0.0, [0.01, 0.01, 0.01, 0.2, 0.2, 0.2], wrench.shape)
    levels = find_levels([ReadingBlock(t_s, wrench + noise)])
    assert len(levels) == len(values)
    return list(levels)


def notebook() -> list[Note]:
    lines = []
    for posture, location in (("hook", "tip"), ("flat", "bone")):
        lines += [f"{name} {mass}, {posture}, {location}" for name in TENDONS for mass in (300, 700)]
    return list(read_notes("\n".join(lines), TENDONS))


def lines_of(layout: Layout) -> list[int | None]:
    return [laid.note for laid in layout.plateaus if laid.kind == "load"]


@pytest.mark.parametrize("between", [False, True])
def test_every_line_is_found_in_order_with_its_tare(between: bool) -> None:
    notes = notebook()
    levels = recording(notes, between)
    layout = lay(levels, notes)
    assert lines_of(layout) == list(range(len(notes)))
    assert layout.not_found == ()
    assert min(laid.sure for laid in layout.plateaus) > 0.6
    cases = cases_of(levels, chosen(layout, notes))
    assert len(cases) == len(notes)
    assert all(c["unloaded_s"][1] < c["loaded_s"][0] for c in cases)
    assert len({c["unloaded_s"][0] for c in cases}) == (len(notes) if between else 2)
    # The last load of a block has no tare behind it that is surely its own.
    assert sum("unloaded_after_s" in c for c in cases) == (len(notes) - 2 if between else 0)


def test_a_plateau_of_which_nobody_wrote_and_a_line_that_was_never_read_are_not_sure() -> None:
    notes = notebook()
    layout = lay(recording(notes, True, also=(5,)), notes)
    right = sum(a == b for a, b in zip(lines_of(layout), range(len(notes)), strict=False))
    assert right >= len(notes) - 1 or any(laid.sure <= 0.5 for laid in layout.plateaus)
    assert any(laid.sure <= 0.5 for laid in layout.plateaus)
    lost = [*notes[:12], notes[12], *notes[12:]]
    layout = lay(recording(notes, True), lost)
    assert len(layout.not_found) == 1
    assert layout.not_found[0] in (12, 13)
    assert any(laid.sure <= 0.5 for laid in layout.plateaus)


def test_a_tare_that_was_written_down_is_taken_there() -> None:
    notes = list(read_notes("tare\nFDP 700, hook, tip\nFDS 700\nskip\ntare\nEDC 700", TENDONS))
    played = [n for n in notes if n.kind == "load"]
    levels = recording(played, True)  # tare load tare load tare load
    layout = lay(levels, [notes[0], notes[1], *notes[2:3], notes[5]])
    assert [laid.kind for laid in layout.plateaus] == ["tare", "load"] * 3


def test_a_load_without_a_tare_is_refused() -> None:
    notes = notebook()[:2]
    levels = recording(notes, True)
    choices = chosen(lay(levels, notes), notes)
    with pytest.raises(InputError, match=r"the load at .* \(hook, tip\) has no tare before it"):
        cases_of(levels[1:], choices[1:])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("tap_shows", "overload_rests"), [(True, True), (True, False), (False, True), (False, False)])
def test_weights_that_are_moved_are_told_from_others_that_are_hung(
    tap_shows: bool, overload_rests: bool, seed: int
) -> None:
    """As in the friction protocol: hung, overloaded, unloaded, tapped, with 3 % of friction between the motions."""
    motions = "{0} 500, hook, {1}\nskip\n{0} 500, unloading\n{0} 500, unloading, tapped\n"
    notes = read_notes("".join(motions.format(name, at) for at in ("tip", "bone") for name in TENDONS), TENDONS)
    rng = np.random.default_rng(seed)
    values: list[Floats] = []
    right: list[int | None] = []
    arms: dict[object, tuple[Floats, Floats]] = {}
    hung: Floats = np.zeros(6)
    for i, note in enumerate(notes):
        if note.kind == "load" and note.block not in arms:
            tare = rng.normal(0.0, [2, 2, 2, 20, 20, 20])
            arms[note.block] = tare, rng.normal(0.0, [4e-3, 4e-3, 4e-3, 0.03, 0.03, 0.03], (len(TENDONS), 6))
            values.append(tare)
            right.append(None)
        if (note.tapped and not tap_shows) or (note.kind == "skip" and not overload_rests):
            continue
        tare, arm = arms[note.block] if note.kind == "load" else (values[-1] - hung, np.zeros((len(TENDONS), 6)))
        if note.kind == "load":
            hung = np.array([dict(note.masses_g).get(name, 0.0) for name in TENDONS]) @ arm
        factor = 1.2 if note.kind == "skip" else 1.03 if note.tapped else 1.06 if note.direction == "unloading" else 1.0
        values.append(tare + factor * hung)
        right.append(i)
    t_s = np.arange(0.0, 4.0 * len(values), 0.05)
    wrench = np.array(values)[np.minimum((t_s // 4.0).astype(int), len(values) - 1)]
    noise = rng.normal(0.0, [0.01, 0.01, 0.01, 0.2, 0.2, 0.2], wrench.shape)
    levels = find_levels([ReadingBlock(t_s, wrench + noise)])
    layout = lay(levels, notes)
    assert [laid.note for laid in layout.plateaus] == right
    # Where a plateau may be either motion, it is not called sure.
    moved = [laid for laid in layout.plateaus if laid.note is not None and notes[laid.note].direction == "unloading"]
    assert tap_shows or max(laid.sure for laid in moved) <= 0.5


def test_hundreds_of_plateaus_are_laid_without_room_for_all_their_pairs() -> None:
    rng = np.random.default_rng(6)
    (level,) = find_levels([ReadingBlock(np.arange(0.0, 3.0, 0.01), rng.normal(0.0, 0.01, (300, 6)))])
    many = [replace(level, plateau=replace(level.plateau, mean=mean)) for mean in rng.normal(size=(450, 6))]
    tracemalloc.start()
    try:
        layout = lay(many, ())
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(layout.plateaus) == 450
    assert most < 7.5e6  # the distances of all pairs, axis by axis, are 9.7 MB
