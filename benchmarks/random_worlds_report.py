"""The page that `benchmarks.random_worlds` writes: scores, verdicts, reliability, and both by stratum."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from benchmarks import random_worlds_scores as scores
from benchmarks.random_worlds_scores import Row
from benchmarks.recovery import wilson

_BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.995, 1.01)


def _rate(what: str, outcomes: Iterable[bool]) -> str:
    values = list(outcomes)
    low, high = wilson(sum(values), len(values))
    share = f"{100 * sum(values) / len(values):.1f} %" if values else "–"
    return f"| {what} | {share} | {100 * low:.1f}–{100 * high:.1f} % | {sum(values)}/{len(values)} |"


def _mean(what: str, rows: Sequence[Row], score: Callable[[Row], float]) -> str:
    values = [score(r) for r in rows]
    low, high = scores.interval(values)
    mean = f"{np.mean(values):.3f}" if values else "–"
    return f"| {what} | {mean} | {low:.3f}–{high:.3f} | {len(values)} |"


def _verdicts(rows: Sequence[Row]) -> list[str]:
    answered = [r for r in rows if not r["refused"]]
    clear = scores.scored(answered)
    sure = [r for r in answered if r["answer"]["verdict"] == "found" and r["answer"]["probability"] >= 0.9]
    sure_clear = [r for r in sure if scores.stratum_of(r) != "like_catalogue"]
    nulls = [r for r in clear if scores.category_of(r) == "nothing"]
    bare = [r for r in nulls if not r["truth"]["slips"]]
    outside = [r for r in clear if scores.category_of(r) == "outside"]
    one = [r for r in clear if len(r["truth"]["effects"]) == 1]
    two = [r for r in clear if len(r["truth"]["effects"]) == len(scores.seen_effects(r)) == 2]
    slipped = [r for r in answered if scores.slip_cases(r, shown=True)]

    def said(r: Row, kind: str) -> bool:
        return bool(r["answer"]["verdict"] == kind)

    def found(r: Row) -> bool:
        return said(r, "found") and set(r["answer"]["effects"]) == set(r["truth"]["effects"])

    def held(r: Row) -> bool:
        return set(r["truth"]["effects"]) <= set(r["answer"]["effects"])

    def first(r: Row) -> bool:
        named = scores.suspects_of(r, 0.9)
        return bool(named) and named[0] in scores.slip_cases(r)

    def accused(r: Row) -> bool:
        return bool(set(scores.suspects_of(r, 0.5)) - scores.slip_cases(r))

    return [
        _rate(
            "named with probability 0.9 or more: all names true", (scores.verdict_true(r) is True for r in sure_clear)
        ),
        _rate(
            "the same, without slips", (scores.verdict_true(r) is True for r in sure_clear if not r["truth"]["slips"])
        ),
        _rate("nothing named where nothing is missing", (not r["answer"]["effects"] for r in nulls)),
        _rate("`nothing_missing` said there, without a slip", (said(r, "nothing_missing") for r in bare)),
        _rate("`none_of_catalogue` said there, without a slip", (said(r, "none_of_catalogue") for r in bare)),
        _rate(
            "`none_of_catalogue` said there, with a slip",
            (said(r, "none_of_catalogue") for r in nulls if r not in bare),
        ),
        _rate("one effect that shows: found, and nothing else", (found(r) for r in one)),
        _rate("one effect that shows: named, alone or among others", (held(r) for r in one)),
        _rate("one effect that shows: called outside the catalogue", (said(r, "none_of_catalogue") for r in one)),
        _rate("two that show: both found, and nothing else", (found(r) for r in two)),
        _rate("outside declared so", (said(r, "none_of_catalogue") for r in outside)),
        _rate("outside: not named as something else", (not r["answer"]["effects"] for r in outside)),
        _rate("a slip that shows: named first, 0.9 or more", (first(r) for r in slipped)),
        _rate("one effect that shows, beside a slip that shows: found", (found(r) for r in one if r in slipped)),
        _rate("a case accused without cause, 0.5 or more", (accused(r) for r in answered)),
        _rate("refused or crashed", (bool(r["refused"]) for r in rows)),
    ]


def _reliability(pairs: Sequence[tuple[float, bool]]) -> list[str]:
    lines = ["| stated | came true | 95 % (Wilson) | count |", "|---|---|---|---|"]
    for low, high in pairwise(_BINS):
        chosen = [(p, true) for p, true in pairs if low <= p < high]
        if chosen:
            true = sum(t for _, t in chosen)
            least, most = wilson(true, len(chosen))
            mean = sum(p for p, _ in chosen) / len(chosen)
            lines.append(f"| {mean:.3f} | {true / len(chosen):.3f} | {least:.3f}–{most:.3f} | {true}/{len(chosen)} |")
    return lines


_STRATA: dict[str, Callable[[Row], bool]] = {
    "scatter below 0.5 %": lambda r: bool(r["truth"]["scatter_pct"] < 0.5),
    "scatter 0.5 to 1.5 %": lambda r: bool(0.5 <= r["truth"]["scatter_pct"] < 1.5),
    "scatter above 1.5 %": lambda r: bool(r["truth"]["scatter_pct"] >= 1.5),
    "no slip": lambda r: not r["truth"]["slips"],
    "one slip or more": lambda r: bool(r["truth"]["slips"]),
    "budget below 1.5": lambda r: bool(r["truth"]["budget_multiple"] < 1.5),
    "budget above 1.5": lambda r: bool(r["truth"]["budget_multiple"] >= 1.5),
    "Gaussian noise": lambda r: r["truth"]["noise"]["dof"] is None,
    "Student's noise": lambda r: r["truth"]["noise"]["dof"] is not None,
    "fewer than 48 cases": lambda r: bool(r["truth"]["cases"] < 48),
    "48 cases or more": lambda r: bool(r["truth"]["cases"] >= 48),
    "first simulator's physics": lambda r: bool(r["truth"]["engine"] == "first"),
    "second simulator's physics": lambda r: bool(r["truth"]["engine"] == "second"),
    **{f"hidden: {k}": (lambda r, k=k: bool(r["truth"]["kind"] == k)) for k in ("nothing", "one", "two", "outside")},  # type: ignore[misc]
    "within budget, scatter below 0.5 %, no slip": lambda r: bool(
        r["truth"]["scatter_pct"] < 0.5 and not r["truth"]["slips"] and r["truth"]["budget_multiple"] < 1.5
    ),
}


def report(rows: Sequence[Row], command: str) -> list[str]:
    """The figures as lines of Markdown."""
    clear = scores.scored(rows)
    verdicts = [(r, scores.verdict_true(r)) for r in clear if not r["refused"]]
    stated = [(float(r["answer"]["probability"]), true) for r, true in verdicts if true is not None]
    effects = [term for r in rows if not r["refused"] for term in scores.effect_terms(r)]
    unseen = {k: [r for r in rows if scores.stratum_of(r) == k] for k in ("unseen", "like_catalogue")}
    seconds = [r["wall_s"] for r in rows]
    lines = [
        "# Random worlds",
        "",
        f"Made by `{command}` on {dt.datetime.now(dt.UTC).date()}, commit "
        f"{', '.join(dict.fromkeys(r['commit'] for r in rows))}; {len(rows)} sessions of `tests/random_worlds`,",
        f"{np.median(seconds):.1f} s each (median). Everything is drawn: what is hidden and how",
        "large it is, protocol, finger, budget (0.5 to 4 times), scatter (0 to 4 %), noise and slips of the pen.",
        f"What is hidden counts as shown if it changes the fitted readings by {scores.SHOWS:g} standard uncertainties",
        "or more; a law from outside must keep as many beside the one effect of the catalogue that is nearest to it.",
        "",
        "## Scores",
        "",
        "Log scores in nats, 0 is perfect; no probability counts as less than 0.001.",
        "",
        "| score | mean | 95 % (bootstrap) | sessions |",
        "|---|---|---|---|",
        *(_mean(name, clear, score) for name, score in scores.SCORES.items()),
        *(_mean(f"{k}: each effect there or not, log", some, scores.effects_log) for k, some in unseen.items()),
        *(_mean(f"{k}: catalogue, nothing or outside, log", some, scores.category_log) for k, some in unseen.items()),
        "",
        "## Verdicts",
        "",
        "| figure | rate | 95 % (Wilson) | count |",
        "|---|---|---|---|",
        *_verdicts(rows),
        "",
        "## Reliability",
        "",
        "Of the verdict's probability, where it says something and what is hidden shows:",
        "",
        *_reliability(stated),
        "",
        "Of the probability of each effect:",
        "",
        *_reliability(effects),
        "",
        "## By stratum",
        "",
        "A verdict that is undecided is neither right nor wrong.",
        "",
        "| sessions | nothing, catalogue, outside: log | each effect: log | whole truth: log | right | wrong | count |",
        "|---|---|---|---|---|---|---|",
    ]
    three = (scores.category_log, scores.effects_log, scores.exact_log)
    for name, belongs in _STRATA.items():
        some = [r for r in clear if belongs(r)]
        if some:
            means = " | ".join(f"{np.mean([score(r) for r in some]):.3f}" for score in three)
            said = [scores.verdict_true(r) for r in some if not r["refused"]]
            lines.append(f"| {name} | {means} | {said.count(True)} | {said.count(False)} | {len(some)} |")
    return [*lines, "", *_estimates(rows)]


def _estimates(rows: Sequence[Row]) -> list[str]:
    """What is said of scatter and budget, where anything is."""
    answered = [r for r in rows if not r["refused"]]
    scatter = [
        (
            r["answer"]["repeatability"]["value_pct"],
            r["answer"]["repeatability"].get("sd_pct"),
            r["truth"]["scatter_pct"],
        )
        for r in answered
        if (r["answer"].get("repeatability") or {}).get("value_pct") is not None
    ]
    budget = [
        (
            r["answer"]["budget_multiple"]["value"],
            r["answer"]["budget_multiple"].get("sd"),
            r["truth"]["budget_multiple"],
        )
        for r in answered
        if (r["answer"].get("budget_multiple") or {}).get("value") is not None
    ]
    lines = []
    for name, said in (("Scatter [%]", scatter), ("Budget multiple", budget)):
        if said:
            error = np.median([abs(value - true) for value, _, true in said])
            lines.append(f"{name}: median error {error:.2f} in {len(said)} sessions.")
            held = [abs(value - true) <= 2.0 * sd for value, sd, true in said if sd]
            lines[-1] += f" Within two stated standard deviations: {sum(held)}/{len(held)}." if held else ""
    return ["## Scatter and budget as stated", "", *lines, ""] if lines else []


def comparison(new: Sequence[Row], old: Sequence[Row]) -> list[str]:
    """The paired differences as lines of Markdown."""
    names = [", ".join(dict.fromkeys(r["commit"] for r in rows)) for rows in (new, old)]
    lines = [f"## {names[0]} against {names[1]}", "", "Below zero is better; the same sessions on both sides.", ""]
    lines += ["| score | difference | 95 % (bootstrap) | sessions |", "|---|---|---|---|"]
    for name, (count, mean, low, high) in scores.paired(new, old).items():
        lines.append(f"| {name} | {mean:+.4f} | {low:+.4f} to {high:+.4f} | {count} |")
    return [*lines, ""]
