"""Input of the service's figures: the requested model, an average's members, an effect's values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fingermodel.comparing import compare
from fingermodel.comparison.comparison import Comparison
from fingermodel.session import Session
from fingermodel.stages import Effect
from server.figures.arrows import Spread, spread_between
from server.figures.effect_change import Setting
from server.service.figures.cases import Told, told_of
from server.service.models.session_models import IN_FORCE
from server.service.services import Services
from server.service.sessions.blinding import blinded
from server.service.sessions.measuring import Measured
from server.service.web.problems import ProblemError, not_found

_MOST_MEMBERS = 20


def resolved(parts: Services, measured: Measured, model: str | None) -> str | None:
    """Return the model that a request names, with the revision itself instead of `in_force`.

    Raises:
        ProblemError: 422 there is no such model.
    """
    if model == IN_FORCE:
        document = measured.record.document or {}
        model = parts.revisions.in_force(str((document.get("specimen") or {}).get("id")))
    if model is not None:
        parts.models.model(model, measured)
    return model


def about_of(measured: Measured, bench: Session) -> dict[str, Any]:
    """Return what a figure of a session and a model states of both."""
    return {
        "session": measured.record.id,
        "session_version": measured.record.version,
        "model": bench.loaded.name,
        "blinded": sorted(blinded(measured)),
    }


def cases_led_to(measured: Measured) -> list[Told]:
    """Return the cases that a figure may lead to: while a bench is running, none of validation."""
    hidden = blinded(measured)
    return [c for c in told_of(measured.record.amended_cases) if c.id not in hidden]


def spread_members(parts: Services, measured: Measured) -> list[Measured]:
    """Return the sessions that a session is the mean of, as far as the service has them."""
    session = measured.session
    out = []
    for name in () if session is None else session.mean_of[:_MOST_MEMBERS]:
        try:
            member = parts.measuring.of(name)
        except ProblemError:
            continue
        if member.record.closed and member.measured is not None:
            out.append(member)
    return out


def spread_of(parts: Services, members: Sequence[Measured], comparison: Comparison) -> Mapping[str, Spread] | None:
    """Return the standard deviation between the members of an average by case; None where there are none."""
    if not members:
        return None
    return spread_between(comparison, [compare(parts.models.bench(m)) for m in members])


def settings_of(bench: Session, name: str, found: Mapping[str, float]) -> tuple[str, list[Setting]]:
    """Return the title of an effect, and the values that its parameters are given for a picture of what it changes.

    A parameter that the model has fitted keeps its value; others take the upper end of their plausible range, or
    their prior's standard deviation.

    Args:
        bench: whose model holds the effect.
        name: of the effect (all its candidates at once), of a candidate or of a parameter.
        found: values that a search has found, by parameter.

    Raises:
        ProblemError: 404 the effect has no such candidate and no such parameter.
    """
    model = bench.model
    effect = next((e for e in model.effects if e.name == name.split(".", maxsplit=1)[0]), None)
    if effect is None:
        raise not_found("effect", name, "/api/v1/effects")
    topology, layout = model.finger.topology, model.layout
    settings = []
    for parameter in _chosen(effect, name, bench):
        index = model.parameters.index[parameter]
        declared = model.parameters.parameters[index]
        if parameter in bench.loaded.added:
            value, why = found.get(parameter, float(bench.theta[index])), "as fitted"
        elif declared.plausible is not None:
            value, why = declared.plausible[1], "upper end of the plausible range"
        else:
            value, why = declared.initial + declared.sd, "one standard deviation of the prior"
        settings.append(Setting(parameter, float(value), declared.unit, why))
    known = len(effect.parameters(topology, layout))
    if not settings and known:
        places = ", ".join([*effect.variants(topology, layout), *(p.name for p in effect.parameters(topology, layout))])
        raise ProblemError(404, f"effect {effect.name} has no {name[:200]}", f"{effect.name}, or one of {places}"[:500])
    return effect.title or effect.name, settings


def _chosen(effect: Effect, name: str, bench: Session) -> list[str]:
    topology, layout = bench.model.finger.topology, bench.model.layout
    variants = effect.variants(topology, layout)
    declared = [p.name for p in effect.parameters(topology, layout)]
    held = [p for p in bench.loaded.added if p in declared]
    if name in declared:
        return [name]
    if name == effect.name and held:
        return held
    if name in variants:
        return list(variants[name][0])
    if name == effect.name:
        return list(dict.fromkeys(p for alternatives in variants.values() for p in alternatives[0]))
    return []
