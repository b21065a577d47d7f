"""Scores of stated probabilities against what was hidden: log score, Brier score, intervals.

A log score is minus the logarithm of the probability given to what is so: 0 is perfect. No probability counts as less
than one in a thousand; a session that was refused, or that crashed, gets that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from tests.random_worlds.engines import NAMES

Row = Mapping[str, Any]
LEAST = 1e-3
WORST = float(-np.log(LEAST))
# Standard uncertainties in all below which a change is not there to be seen, and a slip to be named.
SHOWS, SLIP_SHOWS = 3.0, 5.0
OUTSIDE = "none_of_catalogue"


def kept_of(answer: Mapping[str, Any]) -> dict[str, Any]:
    """What the scores need of an answer; keys that it lacks are left out."""
    keys = ("verdict", "effects", "probability", "inclusion", "repeatability", "beyond", "budget_multiple", "seconds")
    kept = {k: answer[k] for k in keys if answer.get(k) is not None}
    kept["ranking"] = [{k: r[k] for k in ("effects", "probability")} for r in answer["ranking"] if r["probability"]]
    if answer.get("suspects") is not None:
        kept["suspects"] = [{k: s[k] for k in ("case", "probability")} for s in answer["suspects"]]
    return kept


def inclusion_of(answer: Mapping[str, Any], name: str) -> float:
    """Probability that an effect acts, at whichever tendon or mount."""
    given = answer["inclusion"]
    if name in given:
        return float(given[name])
    return min(sum(float(p) for key, p in given.items() if key.split(".")[0] == name), 1.0)


def category_of(row: Row) -> str:
    """What was hidden: nothing, catalogue or outside."""
    return "outside" if row["truth"]["outside"] else ("catalogue" if row["truth"]["effects"] else "nothing")


def stratum_of(row: Row) -> str:
    """Whether what was hidden can be seen for what it is: shows, unseen or like_catalogue."""
    truth = row["truth"]
    if category_of(row) == "nothing":
        return "shows"
    if truth["sds"] < SHOWS:
        return "unseen"
    return "like_catalogue" if truth["outside"] and truth["sds_unlike_catalogue"] < SHOWS else "shows"


def seen_effects(row: Row) -> set[str]:
    """Effects of the catalogue that act and show beside each other."""
    return {p["name"] for p in row["truth"]["parts"] if p["name"] and p["sds_beside"] >= SHOWS}


def categories(row: Row) -> dict[str, float]:
    """Probability given to nothing, catalogue and outside, which add to one."""
    out = {"nothing": 0.0, "catalogue": 0.0, "outside": 0.0}
    for r in row["answer"]["ranking"]:
        known = [e for e in r["effects"] if e in NAMES]
        out["catalogue" if known else ("outside" if r["effects"] else "nothing")] += float(r["probability"])
    # What a ranking does not list is some explanation of the catalogue.
    out["catalogue"] += max(1.0 - sum(out.values()), 0.0)
    total = sum(out.values())
    return {k: p / total for k, p in out.items()}


def log_score(probability: float) -> float:
    """Of what is so: minus the logarithm, 0 where it was certain."""
    return float(-np.log(min(max(probability, LEAST), 1.0)))


def effect_terms(row: Row) -> list[tuple[float, bool]]:
    """Probability and truth of each effect, but those that act unseen or that a law from outside looks like."""
    truth = row["truth"]
    hidden = set(truth["effects"]) - seen_effects(row)
    hidden |= {truth["most_like"]} if stratum_of(row) == "like_catalogue" else set()
    return [(inclusion_of(row["answer"], n), n in truth["effects"]) for n in NAMES if n not in hidden]


def effects_log(row: Row) -> float:
    """Mean over the catalogue of the log score of each effect, there or not."""
    if row["refused"]:
        return WORST
    return float(np.mean([log_score(p if there else 1.0 - p) for p, there in effect_terms(row)]))


def effects_brier(row: Row) -> float:
    """Mean over the catalogue of the squared error of each effect's probability."""
    return 1.0 if row["refused"] else float(np.mean([(p - there) ** 2 for p, there in effect_terms(row)]))


def category_log(row: Row) -> float:
    """Log score of nothing, catalogue or outside."""
    return WORST if row["refused"] else log_score(categories(row)[category_of(row)])


def category_brier(row: Row) -> float:
    """Squared errors of the three probabilities, 0 to 2."""
    if row["refused"]:
        return 2.0
    true = category_of(row)
    return sum((p - (k == true)) ** 2 for k, p in categories(row).items())


def exact_log(row: Row) -> float:
    """Log score of the whole truth: nothing, exactly this set of effects, or outside."""
    if row["refused"] or category_of(row) != "catalogue":
        return category_log(row)
    wanted = set(row["truth"]["effects"])
    return log_score(sum(float(r["probability"]) for r in row["answer"]["ranking"] if set(r["effects"]) == wanted))


SCORES: dict[str, Callable[[Row], float]] = {
    "nothing, catalogue or outside: log": category_log,
    "nothing, catalogue or outside: Brier": category_brier,
    "the whole truth: log": exact_log,
    "each effect there or not: log": effects_log,
    "each effect there or not: Brier": effects_brier,
}


def scored(rows: Iterable[Row]) -> list[Row]:
    """Sessions that the headline counts: what is hidden shows for what it is."""
    return [r for r in rows if stratum_of(r) == "shows"]


def interval(values: Sequence[float], draws: int = 4000) -> tuple[float, float]:
    """95 % interval of a mean, by drawing the sessions again."""
    if not values:
        return 0.0, 0.0
    rng = np.random.default_rng(0)
    given = np.asarray(values, dtype=float)
    means = given[rng.integers(len(given), size=(draws, len(given)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def paired(new: Sequence[Row], old: Sequence[Row]) -> dict[str, tuple[int, float, float, float]]:
    """Of sessions in both: how many, mean of new less old, and its interval, by score; below zero is better."""
    before = {tuple(r["seed"]): r for r in old}
    both = [(r, before[tuple(r["seed"])]) for r in scored(new) if tuple(r["seed"]) in before]
    out = {}
    for name, score in SCORES.items():
        changes = [score(a) - score(b) for a, b in both]
        out[name] = (len(changes), float(np.mean(changes)) if changes else 0.0, *interval(changes))
    return out


def verdict_true(row: Row) -> bool | None:
    """Whether what the verdict says is so; none where it says nothing."""
    answer, truth = row["answer"], row["truth"]
    named = set(answer["effects"])
    return {
        "found": bool(named) and named <= set(truth["effects"]),
        "one_of": bool(named & set(truth["effects"])),
        "none_of_catalogue": bool(truth["outside"]),
        "nothing_missing": category_of(row) == "nothing",
    }.get(answer["verdict"])


def slip_cases(row: Row, shown: bool = False) -> set[str]:
    """Cases whose lines are wrong as diagnosed; `shown`: of slips in fitted cases that are there to be seen."""
    slips = [s for s in row["truth"]["slips"] if not shown or (s["fitted"] and s["sds"] >= SLIP_SHOWS)]
    return {c for s in slips for c in s["cases"]} - set(row.get("mended", []))


def suspects_of(row: Row, least: float) -> list[str]:
    """Cases that an answer suspects with this probability or more, first one first."""
    return [s["case"] for s in row["answer"].get("suspects", []) if s["probability"] >= least]
