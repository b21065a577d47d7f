"""The verdict, read off the posterior's marginals: found, one of, none of the catalogue, nothing missing, undecided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import chdtrc

from fingermodel.diagnosis.posterior.hyper import ANATOMY, BUDGET, FORMS, NOISE, OF_GROUPS, Node
from fingermodel.diagnosis.posterior.marginals import Posterior, summed
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import Candidate, Candidates
from fingermodel.diagnosis.session_model.group_errors import GroupErrors
from fingermodel.diagnosis.settings import EXTRA_NOISE_N, FORM_NAMED, LEAST_CASES, OF_GROUP, P_VALUE, SURE
from fingermodel.diagnosis.verdict.confounding import Confounding
from fingermodel.diagnosis.verdict.far_off import beyond_priors, far_off
from fingermodel.diagnosis.verdict.trend import Trend
from fingermodel.fitting.reading_errors import other_scatter

Kind = Literal["found", "one_of", "none_of_catalogue", "nothing_missing", "undecided"]

# Probability from which nothing is said to be missing.
_NOTHING_SURE = 0.8
# From this multiple on a budget or a noise is said to be larger than stated.
_LARGER = 1.1
# What plateau and tare do not show is more than usual from here on [N].
_USUAL_EXTRA_N = 2.0 * EXTRA_NOISE_N.scale


@dataclass(frozen=True)
class Verdict:
    """What the data say, and why."""

    kind: Kind  # the verdict
    names: tuple[str, ...]  # candidates that it names
    effects: tuple[str, ...]  # their effects; empty unless found or one of
    probability: float  # of the verdict; of the likeliest statement where it is undecided
    reasons: tuple[str, ...] = ()  # plain sentences for it
    short: tuple[str, ...] = ()  # what was short of a stronger verdict

    def lacking(self, what: str) -> Verdict:
        """Undecided for want of something, with all that speaks for it."""
        return replace(self, kind="undecided", effects=(), short=(what,))


def judge(
    posterior: Posterior,
    stated: Optimum,
    candidates: Candidates,
    classes: Confounding,
    p_value: float | None,
    checked: Sequence[str],
    missed: Sequence[str],
) -> Verdict:
    """Read the verdict.

    Args:
        posterior: of the session.
        stated: the base model as budget and noise are stated.
        candidates: that were searched.
        classes: what the load cases cannot tell apart.
        p_value: predictive check of the validation cases, under all that has what the verdict would add.
        checked: names of what was checked.
        missed: validation cases that are out of the question under these.
    """
    verdict = _undisputed(posterior, stated, candidates, classes)
    cases = _cases(posterior)
    if cases < LEAST_CASES:
        short = f"{cases} identification cases are too few to decide anything (at least {LEAST_CASES})"
        return verdict.lacking(short)
    if p_value is not None and p_value < P_VALUE and verdict.kind != "none_of_catalogue":
        what = words(checked) or "the model without any effect"
        short = (
            f"the validation cases are not as {what} predicts them (predictive check: p = {p_value:.1g}"
            f"{f', most of all {words(missed[:3])}' if missed else ''}); "
            "something acts there that the fitted cases do not show"
        )
        told = verdict if verdict.names else replace(verdict, reasons=())
        return replace(told.lacking(short), short=(*verdict.short, short))
    return verdict


def with_unlike(verdict: Verdict, cases: Sequence[str]) -> Verdict:
    """The verdict where cases (ids) stand apart that no slip explains, and that no other fitted case is like."""
    them = "them" if len(cases) > 1 else "it"
    what = (
        f"no slip explains the readings of {words(cases)}, and no other fitted case loads the same tendons as much at "
        f"the same mount: something may act there alone; measure {them} again, and more like {them}"
    )
    if verdict.kind == "nothing_missing":
        return replace(verdict, reasons=()).lacking(what)
    return replace(verdict, reasons=(*verdict.reasons, f"{what[0].upper()}{what[1:]}."))


def doubted(verdict: Verdict, fit: Optimum, trend: Trend) -> Verdict:
    """The verdict where what is left goes with time or load: where that is less than what is found, it stands.

    Where it is of the same quantity, the law itself changes, and by more than a tenth it is another one. The fit is of
    what the verdict would add.
    """
    if verdict.kind not in ("found", "nothing_missing", "one_of"):
        return verdict
    if verdict.kind == "found":
        least = fit.newton * (FORM_NAMED if trend.of_found else 1.0)
        if trend.size_N < least:
            return verdict
    return verdict.lacking(trend.sentence)


def likeliest(posterior: Posterior) -> tuple[str, ...]:
    """Names that the verdict would add: those that are sure, else those of the most probable explanation."""
    sure = sure_names(posterior)
    if sure and posterior.best_fit(sure) is not None:
        return sure
    return posterior.leader.explanation.names


def sure_names(posterior: Posterior) -> tuple[str, ...]:
    """Names of which each is sure by itself."""
    return tuple(name for name, p in posterior.inclusion.items() if p >= SURE)


def _undisputed(posterior: Posterior, stated: Optimum, candidates: Candidates, classes: Confounding) -> Verdict:
    known, likely = sure_names(posterior), [name for name, p in posterior.inclusion.items() if p >= 0.5]
    sure = [c for c in candidates.all if c.name in known]
    if sure and posterior.of_names(known) >= SURE:
        return _found(posterior, stated, candidates, classes, sure)
    if posterior.p_beyond >= SURE and not likely:
        return Verdict("none_of_catalogue", (), (), posterior.p_beyond, _beyond(posterior))
    if posterior.p_nothing >= _NOTHING_SURE:
        return _nothing(posterior, stated, candidates, classes)
    for members in _classes_of(posterior, classes):
        p = posterior.of_any(members)
        if p >= SURE:
            named = tuple(n for n in posterior.inclusion if n in members)
            reason = f"These load cases do not tell {words(named)} apart; that one of them acts is sure ({p:.2f})."
            effects = tuple(dict.fromkeys(candidates.by_name[n].effect for n in named))
            return Verdict("one_of", named, effects, p, (reason,))
    return _undecided(posterior)


def _found(
    posterior: Posterior, stated: Optimum, candidates: Candidates, classes: Confounding, sure: Sequence[Candidate]
) -> Verdict:
    names = tuple(c.name for c in sure)
    probability = posterior.of_names(names)
    fit = posterior.best_fit(names) or posterior.leader
    before, after = misfits(stated, fit)
    # Alone it may explain less where something else acts beside it.
    explain = (
        f"{words(names)} {'explain' if len(names) > 1 else 'explains'} the readings: misfit {before:.0f} falls to "
    )
    explains = f"{explain}{after:.0f} for {len(fit.residual)} readings; it" if after < before else words(names)
    moments = f", the moments by {fit.newton_mm:.1f} N mm" if fit.newton_mm else ""
    reasons = [f"{explains} changes the forces by {fit.newton:.3f} N (RMS){moments}."]
    alike = list(dict.fromkeys(a for n in names for a in classes.alike(n) if a not in names))
    if alike:
        asked = dict.fromkeys(shown for n in [*names, *alike] if (shown := candidates.by_name[n].shown_by))
        how = f"; to part them, {', or '.join(list(asked)[:2])}" if asked else ""
        reasons.append(f"In these load cases it is much like {words(alike)}{how}.")
    if posterior.p_beyond >= 0.5:
        less = ": less than what is found changes" if posterior.beyond_newton < fit.newton else ""
        reasons.append(
            f"Something else acts beside it with a probability of {posterior.p_beyond:.2f}, of about "
            f"{posterior.beyond_newton:.2g} N{less}."
        )
        reasons += _known(posterior)
    reasons += _beside(posterior, names)
    # Specimens differ by more than those of one study; of the rig the bench itself states what it may be off by.
    left = _left(posterior, fit, f"{words(names)}, noise, scatter and budget", _rig_as_stated(fit, fit.best))
    if short := left or far_off(fit) or beyond_priors(fit):
        return Verdict("undecided", names, (), probability, tuple(reasons), (short,))
    return Verdict("found", names, tuple(dict.fromkeys(c.effect for c in sure)), probability, tuple(reasons))


def _nothing(posterior: Posterior, fit: Optimum, candidates: Candidates, classes: Confounding) -> Verdict:
    p, misfit = posterior.p_nothing, fit.misfit(fit.node)
    left = _left(posterior, fit, "noise, scatter and budget", fit.node)
    if short := left or far_off(fit) or beyond_priors(posterior.nothing):
        return Verdict("undecided", (), (), p, (), (short,))
    reasons = [
        f"Noise, scatter and the stated budget explain the readings (misfit {misfit:.0f} for {len(fit.residual)} "
        "readings); no effect is needed."
    ]
    if hidden := classes.hidden(candidates):
        reasons.append(f"Effects that these load cases would hardly show, and that are not ruled out: {words(hidden)}.")
    return Verdict("nothing_missing", (), (), p, tuple(reasons))


def _left(posterior: Posterior, fit: Optimum, what: str, node: Node) -> str:
    """What is said where a fit's misfit is out of the question at a node where the rig is as stated."""
    if _explains(fit, node):
        return ""
    (budget, _), (anatomy, _), (noise, _) = map(posterior.hyperparameter, (BUDGET, ANATOMY, NOISE))
    wanted = {"budget": budget, "spread of anatomy": anatomy}
    more = [f"a {name} {times:.1f} times as large" for name, times in wanted.items() if times >= _LARGER]
    usual = GroupErrors.usual(fit.session.model.budget)._asdict()
    of_group = {name: size for name, (size, _) in posterior.other_scatter.items() if name in usual}
    more += other_scatter({name: size for name, size in of_group.items() if size > OF_GROUP.scale * usual[name]})
    if fit.session.observations.noise_assumed:
        more += [f"a noise {noise:.1f} times as large"] if noise >= _LARGER else []
    elif noise > _USUAL_EXTRA_N:
        more.append(f"{1000.0 * noise:.0f} mN of noise beside the measured one")
    want = f"; the readings want {words(more)}" if more else ""
    return f"{what} as stated leave a misfit of {fit.misfit(node):.0f} for {len(fit.residual)} readings{want}"


def explains_as_stated(fit: Optimum) -> bool:
    """Whether a fit leaves a misfit that noise makes where rig and specimen are as stated."""
    return _explains(fit, stated_node(fit))


def explains_with_rig_as_stated(fit: Optimum) -> bool:
    """The same where the specimen, and something smooth, are as the readings have them."""
    return _explains(fit, _rig_as_stated(fit, fit.best))


def _explains(fit: Optimum, node: Node) -> bool:
    return bool(chdtrc(len(fit.residual), fit.misfit(node)) >= P_VALUE)


def stated_node(fit: Optimum) -> Node:
    """The node where budget, anatomy and noise are as stated and nothing smooth acts.

    Scatter is as it reads, and so is noise that plateau and tare do not show, as far as it is usual.
    """
    node = list(fit.hyper.without_smooth(fit.best))
    node[ANATOMY] = fit.hyper.axes[ANATOMY].mode
    return _rig_as_stated(fit, tuple(node))


def _rig_as_stated(fit: Optimum, of: Node) -> Node:
    axes, node = fit.hyper.axes, list(of)
    node[BUDGET] = axes[BUDGET].mode
    usual_of_group = int(np.searchsorted(OF_GROUP.values, OF_GROUP.scale, side="right")) - 1
    node[OF_GROUPS] = [min(size, usual_of_group) for size in node[OF_GROUPS]]
    if not fit.session.observations.noise_assumed:
        usual = np.searchsorted(axes[NOISE].values, _USUAL_EXTRA_N, side="right") - 1
        node[NOISE] = min(node[NOISE], int(usual))
        return tuple(node)
    # An assumed noise is as the readings have it, too: where nothing smooth acts, that is more.
    offers = [(*node[:NOISE], k, *node[NOISE + 1 :]) for k in range(len(axes[NOISE].values))]
    return max(offers, key=fit.log_joint)


def _beyond(posterior: Posterior) -> tuple[str, ...]:
    leader = posterior.leader
    near = words(leader.explanation.names)
    looks = f"; the nearest law of the catalogue, {near}, would have to be another one" if near else ""
    alone = [f", in {carrier} alone" for carrier, p in posterior.carriers.items() if p >= 0.5]
    size = f"{leader.newton_mm:.2g} N mm" if leader.newton_mm else f"{posterior.beyond_newton:.2g} N"
    said = f"Something of about {size} acts that no effect here describes{''.join(alone)}{looks}."
    return (*(_known(posterior) or [said]), *_beside(posterior, ()))


def _known(posterior: Posterior) -> list[str]:
    """What rigs are known for, and the catalogue leaves out, that something unknown mostly looks like."""
    known = summed((candidate, e.probability) for e in posterior.entries for candidate in e.known)
    best = next(iter(known), None)
    if best is None or known[best] < 0.5:
        return []
    return [
        f"Most of it looks like {best.name} (probability {min(known[best], 1.0):.2f}), "
        f"which rigs are known for and the catalogue leaves out: {best.title}."
    ]


def _beside(posterior: Posterior, names: Sequence[str]) -> list[str]:
    """What may act beside some names."""
    found = [(n, p) for n, p in posterior.inclusion.items() if n not in names and 0.1 <= p < SURE]
    listed = ", ".join(f"{n} (probability {p:.2f})" for n, p in found[:3])
    return [f"Beside it may act {listed}."] if found else []


def _undecided(posterior: Posterior) -> Verdict:
    rivals = [(n, p) for n, p in posterior.inclusion.items() if p >= 0.05][:4]
    said = [f"{name} has {p:.2f}" for name, p in rivals]
    said += [f"nothing missing {posterior.p_nothing:.2f}"] if posterior.p_nothing >= 0.05 else []
    said += [f"something outside the catalogue {posterior.p_beyond:.2f}"] if posterior.p_beyond >= 0.05 else []
    names = tuple(n for n, p in rivals if p >= 0.5)
    best = max([posterior.p_nothing, posterior.p_beyond, *(p for _, p in rivals)])
    return Verdict("undecided", names, (), best, (), ("no explanation is sure: " + "; ".join(said),))


def _classes_of(posterior: Posterior, classes: Confounding) -> list[tuple[str, ...]]:
    """Sets of candidates that the load cases cannot tell apart, about the most probable candidates."""
    out = [(name, *classes.alike(name)) for name in list(posterior.inclusion)[:4]]
    return [c for c in out if len(c) > 1]


def misfits(stated: Optimum, fit: Optimum) -> tuple[float, float]:
    """Misfit without and with what an explanation adds: budget as stated, scatter and noise as with the explanation.

    Weighted sums of squares, priors' penalty included.
    """
    node = stated_node(fit) if fit.explanation.size else stated.node
    return stated.misfit(node[:FORMS]), fit.misfit(node)


def _cases(posterior: Posterior) -> int:
    session = posterior.nothing.session
    used = np.unique(session.rows[session.fitted] // 6)
    sound = set(used) - set(posterior.nothing.bad)
    return sum(session.observations.roles[i] == "identification" for i in sound)


def words(names: Sequence[str]) -> str:
    """Names in a sentence."""
    listed = list(names)
    return f"{', '.join(listed[:-1])} and {listed[-1]}" if len(listed) > 1 else "".join(listed)
