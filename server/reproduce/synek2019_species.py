"""Human and bonobo in Synek et al. 2019 (PeerJ 7:e7470): Table 3, the force ratios and what the text says of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from fingermodel.studies.published import Row, not_available, row, row_within

if TYPE_CHECKING:
    from fingermodel.studies.species import SpeciesResult
    from fingermodel.studies.species_sides import Side

HUMAN, BONOBO = "synek2019_HMEAN", "synek2019_B01"
FLEXORS = "FDP+FDS"
# Printed numbers of human and bonobo.
LENGTHS = {"PP": ("47.0", "57.8"), "MP": ("28.8", "38.1"), "DP": ("19.0", "20.4")}
ARMS = {
    "DIP.FDP": ("4.3", "3.9"),
    "PIP.FDP": ("11.1", "10.4"),
    "MCP.FDP": ("12.1", "12.9"),
    "PIP.FDS": ("7.3", "6.6"),
    "MCP.FDS": ("12.8", "13.3"),
}
RATIOS = {
    "tension_to_tip": (("3.78", "3.54", "4.10"), ("5.36", "5.06", "5.66")),
    "bone_to_tip": (("2.87", "2.55", "3.15"), ("4.44", "4.19", "4.68")),
}
HIGHER_PCT = {"tension_to_tip": "42", "bone_to_tip": "55"}
WORDS = {"tension_to_tip": "tension to tip force", "bone_to_tip": "bone to tip force"}
GIVEN = "given: our bonobo is built from it"
OTHER = "not available: this is not the paper's bonobo, whose tendon points are not among the published data"
NO_POINTS = "not available: the bonobo's tendon points are not among the published data; ours are human points scaled"
MEASURED = "measured: the paper prints its models' ratios, not those of its measured forces"
OF_TABLE = "computed from the printed numbers of Table 3, whatever finger is ours"


def species_rows(result: SpeciesResult) -> list[Row]:
    """Set every printed number of the comparison beside ours; none where the two are not the paper's specimens."""
    if (result.of.session, result.other.session) != (HUMAN, BONOBO) or FLEXORS not in result.tendons:
        return []
    note = GIVEN if result.other.name == "synek2019_bonobo" else OTHER
    return [
        *_sizes("{} length", LENGTHS, result.of.lengths_mm, result.other.lengths_mm, note),
        *_sizes("{} mean moment arm", ARMS, result.of.arms_mm, result.other.arms_mm, note),
        *_ratios(result),
        *_relations(),
        *_directions(result),
    ]


def _sizes(
    words: str,
    printed: dict[str, tuple[str, str]],
    human_mm: dict[str, float],
    bonobo_mm: dict[str, float],
    note: str,
) -> Iterator[Row]:
    for name, (human, bonobo) in printed.items():
        if name in human_mm:
            yield row(f"human {words.format(name)}", human, human_mm[name], "mm")
        if name in bonobo_mm:
            yield not_available(f"bonobo {words.format(name)}", bonobo, bonobo_mm[name], "mm", note)


def _ratios(result: SpeciesResult) -> Iterator[Row]:
    for key, (human, bonobo) in RATIOS.items():
        a, b = (side.spread(FLEXORS, key) for side in (result.of, result.other))
        if a is None or b is None:
            continue
        for what, text, ours in zip(("mean", "least", "most"), human, (a.mean, a.least, a.most), strict=True):
            yield row(f"human {WORDS[key]}, {what}", text, ours, "1")
        for what, text, ours in zip(("mean", "least", "most"), bonobo, (b.mean, b.least, b.most), strict=True):
            yield not_available(f"bonobo {WORDS[key]}, {what}", text, ours, "1", NO_POINTS)
        higher = HIGHER_PCT[key]
        name = f"{WORDS[key]} higher in the bonobo"
        yield row(f"{name}, of the printed means", higher, 100.0 * (float(bonobo[0]) / float(human[0]) - 1.0), "%")
        yield not_available(f"{name}, our models", higher, 100.0 * (b.mean / a.mean - 1.0), "%", NO_POINTS)
        for plane in ("space", "sagittal"):
            a, b = (side.spread(FLEXORS, key, measured=True, plane=plane) for side in (result.of, result.other))
            if a is not None and b is not None:
                where = " in the sagittal plane" if plane == "sagittal" else ""
                ours = 100.0 * (b.mean / a.mean - 1.0)
                yield not_available(f"{name}, measured forces{where}", higher, ours, "%", MEASURED)


def _relations() -> Iterator[Row]:
    """Yield rows on the text's statements about Table 3, from the table's own numbers."""
    human, bonobo = (sum(float(pair[i]) for pair in LENGTHS.values()) for i in (0, 1))
    yield row("bonobo's phalanges longer, together", "22", 100.0 * (bonobo / human - 1.0), "%", OF_TABLE)
    larger = {name: 100.0 * (float(b) / float(a) - 1.0) for name, (a, b) in ARMS.items()}
    yield row("bonobo's flexor arms larger, FDS at the MCP", "4", larger["MCP.FDS"], "%", OF_TABLE)
    yield row("bonobo's flexor arms larger, FDP at the MCP", "7", larger["MCP.FDP"], "%", OF_TABLE)
    for name in ("PIP.FDP", "PIP.FDS", "DIP.FDP"):
        joint, tendon = name.split(".")
        yield row_within(f"bonobo's flexor arms larger, {tendon} at the {joint}", "4", "7", larger[name], "%", OF_TABLE)


def _directions(result: SpeciesResult) -> Iterator[Row]:
    """Yield rows on directions: correlations with MCP flexion, and which of the two varies more."""
    for who, side in (("human", result.of), ("bonobo", result.other)):
        for measured in (False, True):
            turned = side.turning(FLEXORS, "bone", measured=measured)
            if turned is not None:
                kind = "measured" if measured else "predicted"
                quantity = f"{who} bone force's direction with MCP flexion, {kind}: correlation"
                yield _said(quantity, turned[0], "negative", turned[0] < 0.0, side, measured=measured)
        joint, bone = (side.turning(FLEXORS, what) for what in ("joint", "bone"))
        if joint is not None and bone is not None:
            quantity = f"{who} joint load's direction with MCP flexion, predicted: correlation"
            yield _said(quantity, joint[0], "positive", joint[0] > 0.0, side)
            quantity = f"{who} range of the joint load's direction over the bone force's"
            yield _said(quantity, joint[1] / bone[1], "more variable", joint[1] > bone[1], side)


def _said(quantity: str, ours: float, word: str, holds: bool, side: Side, *, measured: bool = False) -> Row:
    # A bonobo that is not the paper's can neither confirm nor deny what the paper's predicts.
    known = measured or side.session == HUMAN
    return Row(quantity, None, ours, "1", holds if known else None, "" if known else NO_POINTS, word)
