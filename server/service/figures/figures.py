"""Figures as the command line draws them, as Plotly JSON with words for who cannot see them; each is drawn once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Sequence
from contextlib import suppress
from copy import deepcopy
from typing import TYPE_CHECKING, Any, Literal

from fingermodel import comparing
from fingermodel.comparison.comparison import compare
from fingermodel.session import Session
from server.application.diagnosis_report import FIGURES as DIAGNOSIS
from server.figures.effect_change import effect_figure
from server.figures.effect_on_finger import effect_on_finger
from server.figures.shared_law import FIGURES as SHARED
from server.figures.style import NothingToDrawError
from server.service.answers import Tagged
from server.service.figures.answer import Theme, on_page, shown, shown_data
from server.service.figures.cases import Told, told_of
from server.service.figures.comparison import Only, drawn_comparison
from server.service.figures.diagnosed import diagnosed
from server.service.figures.finger_drawing import draw_finger
from server.service.figures.parts import resolved, spread_members, spread_of
from server.service.figures.parts import settings_of as effect_settings
from server.service.jobs.studies import last_of, study_named
from server.service.services import Services
from server.service.sessions.blinding import blinded, require_closed, seen
from server.service.sessions.measuring import Measured
from server.service.sessions.turns import Made
from server.service.web.problems import ProblemError, not_found

if TYPE_CHECKING:
    import plotly.graph_objects as go

SearchFit = Literal["before", "after"]

COMPARISON = ("scatter", "scatter_validation", "vectors", "bone", "errors", "z")
REVISIONS = ("waterfall",)
_MOST = 512


class Figures:
    """Draws figures, and keeps them as long as what they show is the same.

    Args:
        parts: of the service.
    """

    def __init__(self, parts: Services) -> None:
        self.parts = parts
        self._drawn: Made[Tagged] = Made(_MOST)

    def comparison(
        self, name: str, session: str, model: str | None, before: str | None, only: Only, theme: Theme
    ) -> Tagged:
        """Draw a figure of predicted against measured forces; while a bench is running, without validation cases.

        Args:
            name: of the figure, one of COMPARISON.
            session: that is compared.
            model: with which it is compared.
            before: model that this one is held against; None for none.
            only: which cases and components.
            theme: of the page.

        Raises:
            InputError: the session or a model cannot be used.
            ProblemError: there is no such figure, session or model.
        """
        _require(name, COMPARISON)
        parts, measured = self.parts, self.parts.measuring.of(session)
        named = resolved(parts, measured, model)
        earlier = resolved(parts, measured, before) if before is not None else None
        others = spread_members(parts, measured)
        key = ("comparison", name, measured.key, named, before is not None, earlier, only, tuple(o.key for o in others))

        def draw() -> dict[str, Any]:
            bench = parts.models.bench(measured, named)
            comparison = seen(measured, comparing.compare(bench))
            held = None
            if before is not None:
                other = parts.models.bench(measured, earlier)
                held = (other.loaded.name, other, seen(measured, comparing.compare(other)))
            about = _about(measured, bench) | {"before": None if held is None else held[0]}
            spread = spread_of(parts, others, comparison)
            return _shown(
                name,
                lambda: drawn_comparison(name, bench, comparison, only, held, spread),
                about,
                _told(measured),
            )

        return self._kept(key, theme, draw)

    def effect(self, effect: str, session: str, model: str | None, theme: Theme) -> Tagged:
        """Draw what an effect would change in a session's cases, beside what the model misses in them.

        Args:
            effect: of the catalogue or a user's, one of its candidates, or one of its parameters.
            session: whose cases are drawn; while a bench is running, without validation cases.
            model: as it is without the effect.
            theme: of the page.

        Raises:
            InputError: the session or the model cannot be used.
            ProblemError: there is no such effect, session or model.
        """
        parts, measured = self.parts, self.parts.measuring.of(session)
        named = resolved(parts, measured, model)
        own = parts.effects.named([effect])

        def draw() -> dict[str, Any]:
            bench = parts.models.bench(measured, named, own)
            title, settings = effect_settings(bench, effect, parts.models.found(named, measured))
            table, without = bench.model.parameters, bench.theta.copy()
            within = without.copy()
            for setting in settings:
                at = table.index[setting.name]
                without[at], within[at] = table.initial[at], setting.value
            before = seen(measured, compare(bench.model, bench.observations, without))
            after = seen(measured, compare(bench.model, bench.observations, within))
            about = _about(measured, bench) | {"effect": effect, "parameters": [vars(s) for s in settings]}
            plane = bench.model.finger.judged_in
            caption = (
                f"Model: {bench.loaded.fitted}. The circles are what it misses with the effect taken out; bars that "
                "follow them take it up."
            )
            return _shown(
                effect,
                lambda: (effect_figure(title, before, after, settings, plane=plane), caption),
                about,
                _told(measured),
            )

        return self._kept(("effect", effect, measured.key, named), theme, draw)

    def finger(
        self,
        session: str,
        posture: str | None,
        case: str | None,
        model: str | None,
        without: str | None,
        theme: Theme,
    ) -> Tagged:
        """Draw the finger in a posture, or with the weights and forces of a load case.

        Args:
            session: whose finger it is.
            posture: of the session; by default that of the case.
            case: taken or planned; None for the finger alone.
            model: whose finger and prediction are drawn.
            without: effect of the model without which its case is predicted beside.
            theme: of the page.

        Raises:
            InputError: the session or the model cannot be used.
            ProblemError: there is no such session, posture, case or model.
        """
        measured = self.parts.measuring.of(session)
        named = resolved(self.parts, measured, model)

        def draw() -> dict[str, Any]:
            figure, about = draw_finger(self.parts, measured, posture, case, named)
            if without is not None and case is not None and case not in blinded(measured):
                with suppress(NothingToDrawError):
                    figure = effect_on_finger(self.parts.models.bench(measured, named), [without], case)
            caption = "Joint centres and tendon points are the model's; outlines, clamp and pulleys are schematic."
            head = {"session": session, "session_version": measured.record.version, "blinded": _hidden(measured)}
            return shown("finger", figure, caption, head | about, _told(measured))

        return self._kept(("finger", measured.key, posture, case, named, without), theme, draw)

    def diagnosis(self, name: str, job: str, session: str | None, fit: SearchFit, theme: Theme) -> Tagged:
        """Draw a figure of a diagnosis that is done.

        Args:
            name: of the figure, one of DIAGNOSIS.
            job: of the kinds diagnose or pooled.
            session: of a pooled diagnosis.
            fit: after which residuals are drawn: the refit with nothing added, or with what the verdict would add.
            theme: of the page.

        Raises:
            ProblemError: 404 there is no such figure, job or session, 409 the job is not done, or another.
        """
        _require(name, DIAGNOSIS)
        session, answer, history = diagnosed(self.parts, job, session)

        def draw() -> dict[str, Any]:
            after = answer.get("where_after")
            seen = answer if fit == "before" or after is None else answer | {"where": after}
            drawing, caption = DIAGNOSIS[name]
            about = {"session": session, "model": answer.get("model"), "job": job}
            taken = {c["id"] for c in answer.get("cases", ())}
            known = [c for c in _told(self.parts.measuring.of(session)) if c.id in taken]
            return _shown(name, lambda: (drawing(seen, history), caption), about, known)

        return self._kept(("diagnosis", name, job, session, fit), theme, draw)

    def shared(self, name: str, job: str, theme: Theme) -> Tagged:
        """Draw what several sessions share beyond the catalogue.

        Args:
            name: of the figure, one of SHARED.
            job: of the kind pooled, that is done.
            theme: of the page.

        Raises:
            ProblemError: 404 there is no such figure or job, 409 the job is not done, or another.
        """
        _require(name, SHARED)
        found = self.parts.jobs.get(job)
        if found.kind != "pooled":
            raise ProblemError(409, f"job {job} is a {found.kind}", "a diagnosis of several sessions")
        if found.state != "done" or found.result is None:
            raise ProblemError(409, f"job {job} is {found.state}", "a job that is done")
        answer = found.result
        for session in answer["sessions"]:
            require_closed(self.parts.measuring.of(session))

        def draw() -> dict[str, Any]:
            drawing, caption = SHARED[name]
            return _shown(name, lambda: (drawing(answer), caption), {"job": job})

        return self._kept(("shared", name, job), theme, draw)

    def revisions(self, name: str, revision: str | None, specimen: str | None, theme: Theme) -> Tagged:
        """Draw how the error fell with every step up to a revision.

        Args:
            name: of the figure, one of REVISIONS.
            revision: its id.
            specimen: or that whose revision in force is meant.
            theme: of the page.

        Raises:
            ProblemError: there is no such figure, revision or specimen, or not one of both is given.
        """
        _require(name, REVISIONS)
        if (revision is None) == (specimen is None):
            raise ProblemError(422, "not one of revision and specimen", "one of the two")
        if revision is None:
            revision = self.parts.revisions.in_force(specimen or "")
            if revision is None:
                raise not_found("revision of specimen", specimen or "", "/api/v1/specimens")
        found = self.parts.revisions.read(revision)

        def draw() -> dict[str, Any]:
            about = {"revision": found["id"], "specimen": found["specimen"], "session": found["session"]}
            drawing, caption = DIAGNOSIS["revisions"]
            return _shown(name, lambda: (drawing({}, found["history"]), caption), about)

        return self._kept(("revisions", name, revision), theme, draw)

    def study(self, study: str, name: str, theme: Theme) -> Tagged:
        """Draw a figure of a published study as it was computed last.

        Raises:
            ProblemError: 404 there is no such study or figure, 409 the study was not computed yet.
        """
        found = study_named(study)
        done = last_of(self.parts.jobs, found.name, done=True)
        if done is None or done.result is None:
            raise ProblemError(
                409, f"{study} was not computed yet", "a study that was", f"POST /api/v1/studies/{study}/reproductions"
            )
        figures = {f["name"]: f for f in done.result["figures"]}
        _require(name, list(figures))

        def draw() -> dict[str, Any]:
            return shown_data(name, deepcopy(figures[name]["figure"]), figures[name]["caption"], {"study": study})

        return self._kept(("study", name, done.id), theme, draw)

    def _kept(self, key: Hashable, theme: Theme, draw: Callable[[], dict[str, Any]]) -> Tagged:
        """Return a figure that is kept already, or is drawn now and kept."""
        return self._drawn.of((key, theme), lambda: Tagged.of(on_page(draw(), theme) | {"theme": theme}))


def _shown(
    name: str, draw: Callable[[], tuple[go.Figure, str]], about: dict[str, Any], known: Sequence[Told] = ()
) -> dict[str, Any]:
    """Return the answer of a figure with its caption, or with why there is nothing to draw."""
    try:
        figure, caption = draw()
    except NothingToDrawError as nothing:
        return shown(name, None, nothing.sentence, about)
    return shown(name, figure, caption, about, known)


def _require(name: str, known: Collection[str]) -> None:
    if name not in known:
        raise not_found("figure", name, f"/api/v1/figures: {', '.join(known)}")


def _hidden(measured: Measured) -> list[str]:
    return sorted(blinded(measured))


def _about(measured: Measured, bench: Session) -> dict[str, Any]:
    return {
        "session": measured.record.id,
        "session_version": measured.record.version,
        "model": bench.loaded.name,
        "blinded": _hidden(measured),
    }


def _told(measured: Measured) -> list[Told]:
    """Return the cases that a figure may lead to: while a bench is running, none of validation."""
    hidden = blinded(measured)
    return [c for c in told_of(measured.record.amended_cases) if c.id not in hidden]
