"""Human and bonobo in Synek et al. 2019 (PeerJ 7:e7470): Table 3, the force ratios and what the text says of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from fingermodel.studies.published import Row, not_available, row, row_within
from server.reproduce.printed import reference

if TYPE_CHECKING:
    from fingermodel.studies.species import SpeciesResult
    from fingermodel.studies.species_sides import Side

HUMAN, BONOBO = "synek2019_HMEAN", "synek2019_B01"
FLEXORS = "FDP+FDS"
BONES = ("PP", "MP", "DP")
SEGMENTS = ("DIP.FDP", "PIP.FDP", "MCP.FDP", "PIP.FDS", "MCP.FDS")
HIGHER_PCT = {"tension_to_tip": "42", "bone_to_tip": "55"}
WORDS = {"tension_to_tip": "tension to tip force", "bone_to_tip": "bone to tip force"}
GIVEN = "given: our bonobo is built from it"
NO_POINTS = "not available: the bonobo's tendon points are not among the published data; ours are human points scaled"
OTHER = "not available: this is not the paper's bonobo, whose tendon points are not among the published data"
MEASURED = "measured: the paper prints its models' ratios, not those of its measured forces"
OF_TABLE = "computed from the printed numbers of Table 3, whatever finger is ours"


def species_rows(result: SpeciesResult) -> list[Row]:
    """Set every printed number of the comparison beside ours; none where the two are not the paper's specimens."""
    if (result.of.session, result.other.session) != (HUMAN, BONOBO) or FLEXORS not in result.tendons:
        return []
    note = GIVEN if result.other.name == "synek2019_bonobo" else OTHER
    return [
        *_sizes("{} length", _printed("length", BONES), result.of.lengths_mm, result.other.lengths_mm, note),
        *_sizes("{} mean moment arm", _printed("arm", SEGMENTS), result.of.arms_mm, result.other.arms_mm, note),
        *_ratios(result),
        *_relations(),
        *_directions(result),
    ]


def _printed(kind: str, names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return printed numbers of human and bonobo by name; a kind is length, arm, tension or bone."""
    numbers = reference("synek2019")
    human, bonobo = (
        {name: text for part in parts for _, text, _, name in numbers[part]}
        for parts in (("human",), ("bonobo", "bonobo_given"))
    )
    both = {name: (text, bonobo[name]) for name, text in human.items() if name in bonobo} | numbers["table_3"]
    return {name: both[f"{kind}.{name}"] for name in names}


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
    for key, said in WORDS.items():
        # Of each the mean, the least and the most.
        human, bonobo = zip(*_printed(key.removesuffix("_to_tip"), ("mean", "min", "max")).values(), strict=True)
        a, b = (side.spread(FLEXORS, key) for side in (result.of, result.other))
        if a is None or b is None:
            continue
        for what, text, ours in zip(("mean", "least", "most"), human, (a.mean, a.least, a.most), strict=True):
            yield row(f"human {said}, {what}", text, ours, "1")
        for what, text, ours in zip(("mean", "least", "most"), bonobo, (b.mean, b.least, b.most), strict=True):
            yield not_available(f"bonobo {said}, {what}", text, ours, "1", NO_POINTS)
        higher = HIGHER_PCT[key]
        name = f"{said} higher in the bonobo"
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
    human, bonobo = (sum(float(pair[i]) for pair in _printed("length", BONES).values()) for i in (0, 1))
    yield row("bonobo's phalanges longer, together", "22", 100.0 * (bonobo / human - 1.0), "%", OF_TABLE)
    larger = {name: 100.0 * (float(b) / float(a) - 1.0) for name, (a, b) in _printed("arm", SEGMENTS).items()}
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
