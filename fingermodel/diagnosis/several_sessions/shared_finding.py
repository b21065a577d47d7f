"""What is said of a law that several sessions share and nobody listed: whether, where it lives, what it resembles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import expit

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.curves import STAGES, WHAT, Curves
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.settings import SURE
from fingermodel.diagnosis.several_sessions.shared_law import SharedCurve, StageSearch, p_value, permuted
from fingermodel.diagnosis.several_sessions.shared_laws import Deciding, SharedLaw, shared_laws

# Chance that shuffled sessions gain as much, up to which a law is none.
_NO_CHANCE = 0.02


@dataclass(frozen=True, eq=False)
class SharedFinding:
    """What sessions share that no effect describes."""

    sessions: tuple[str, ...]  # ids
    specimens: tuple[str, ...]  # of each session
    curves: tuple[SharedCurve, ...]  # of each stage, the most evident first
    observed: float  # what sharing gains at most over not sharing, in ln evidence
    shuffled: Floats  # (shuffles,) the same with tendons and signs of the sessions shuffled
    # That the leading curve resembles, best first; none where it is improbable that it is shared.
    laws: tuple[SharedLaw, ...]
    law_curves: Floats  # (laws, parts, postures) each as the leading curve would show it
    deciding: tuple[Deciding, ...] = ()  # readings that would part them, best first, on a specimen like `decided_on`
    decided_between: tuple[str, ...] = ()  # formulas of those laws
    decided_on: str = ""  # session that it helps most, learned from the other specimens

    @property
    def curve(self) -> SharedCurve:
        """The most evident one."""
        return self.curves[0]

    @property
    def permutation_p(self) -> float | None:
        """That chance gains as much; None where nothing was shuffled."""
        return p_value(self.observed, self.shuffled) if len(self.shuffled) else None

    @property
    def is_shared(self) -> bool:
        """Whether they share something: sure rather than an error of each one's own, no chance, of use to most."""
        p = self.permutation_p
        sure = float(expit(self.curve.log_evidence)) >= SURE
        return sure and 2 * len(self._helped) > len(set(self.specimens)) and (p is None or p <= _NO_CHANCE)

    @property
    def _helped(self) -> list[str]:
        """Specimens that the curve, learned from the others, helps, all sessions of each together."""
        of, gain = np.array(self.specimens), self.curve.left_out_gain
        return [one for one in dict.fromkeys(self.specimens) if gain[of == one].sum() > 0.0]

    @property
    def lacking(self) -> tuple[str, ...]:
        """Sessions that the curve, learned from the other specimens, does not help."""
        return tuple(s for s, g in zip(self.sessions, self.curve.left_out_gain, strict=True) if g <= 0.0)

    @property
    def sentence(self) -> str:
        """In plain words."""
        curve, p = self.curve, self.permutation_p
        chance = "" if p is None else f"; chance does as well in {100.0 * p:.{0 if p >= 0.01 else 1}f} % of shuffles"
        if not self.is_shared:
            return (
                "Beyond the catalogue they share nothing that stands out (ln evidence "
                f"{curve.log_evidence:+.1f} over an error of each one's own{chance})."
            )
        return (
            f"Beyond the catalogue they share an error of {WHAT[curve.stage]}, most in {curve.where}: ln evidence "
            f"{curve.log_evidence:+.1f} over an error of each one's own{chance}. Learned from the other "
            f"specimens, it helps {len(self._helped)} of {len(set(self.specimens))}."
        )

    def as_dict(self) -> dict[str, Any]:
        """As the answer gives it."""
        curve = self.curve
        return {
            "found": self.is_shared,
            "sentence": self.sentence,
            "stage": curve.stage,
            "log_evidence_over_own": curve.log_evidence,
            "permutation_p": self.permutation_p,
            "permutations": len(self.shuffled),
            "gain": self.observed,
            "shuffled_gain": self.shuffled.tolist(),
            "left_out_gain": dict(zip(self.sessions, curve.left_out_gain.tolist(), strict=True)),
            "lacking": list(self.lacking),
            "carried_by": curve.carriers(),
            "curves": [self._curve(c) for c in self.curves],
            "laws": [
                self._law(law) | {"curve": curve.tolist()}
                for law, curve in zip(self.laws, self.law_curves, strict=True)
            ],
            "would_decide": {
                "on": self.decided_on,
                "between": list(self.decided_between),
                "readings": [d.as_dict() for d in self.deciding],
            },
        }

    def _curve(self, curve: SharedCurve) -> dict[str, Any]:
        body = curve.as_dict() | {
            "log_evidence_over_own": curve.log_evidence,
            "left_out_gain": dict(zip(self.sessions, curve.left_out_gain.tolist(), strict=True)),
        }
        for i, found in enumerate(body["parts"]):
            found["own"] = {s: curve.own[k, i].tolist() for k, s in enumerate(self.sessions)}
        return body

    def _law(self, law: SharedLaw) -> dict[str, Any]:
        return {
            "formula": law.name,
            "value": law.value,
            "sd": law.sd,
            "unit": law.unit,
            "log_evidence_gain": law.log_evidence,
            "left_out_gain": dict(zip(self.sessions, law.left_out_gain.tolist(), strict=True)),
            "each": {
                s: {"value": float(v), "sd": float(sd)}
                for s, v, sd in zip(self.sessions, law.each, law.each_sd, strict=True)
            },
            "agreement": law.agreement,
            "unseen_rmse_N": {
                s: {place: {"before": a, "after": b} for place, (a, b) in errors.items()}
                for s, errors in zip(self.sessions, law.unseen, strict=True)
            },
            "rivals": list(law.rivals),
            "effect": self._effect(law),
        }

    def _effect(self, law: SharedLaw) -> dict[str, Any] | None:
        """Document of a user's effect with which the law can be added; none where it is an effect already."""
        if law.formula is None:
            return None
        document: dict[str, Any] = law.formula.as_dict()["effect"]
        reach = max(abs(law.value) + 3.0 * law.sd, 1e-9)
        return document | {
            "name": document["name"].replace("hint_", "shared_"),
            "title": "a law that several specimens share",
            "source": f"learned from {', '.join(self.sessions)}: k = {law.value:.3g} ± {law.sd:.2g} {law.unit}",
            "parameters": {"k": {"unit": law.unit, "range": [-reach, reach]}},
        }


def shared_finding(
    sessions: Sequence[str],
    specimens: Sequence[str],
    fits: Sequence[Optimum],
    permutations: int,
    tell: Callable[[float], None] | None = None,
) -> SharedFinding | None:
    """Look for a shared law that nobody listed.

    Args:
        sessions: ids.
        specimens: of each session; those of one are left out, and shuffled, together.
        fits: of each, with what is known to act there by itself.
        permutations: shuffles; 0 for none.
        tell: is told the share done.

    Returns:
        None where the sessions' fingers have other tendons or joints, or all are of one specimen.
    """
    first = fits[0].session.model.finger.topology
    others = [f.session.model.finger.topology for f in fits[1:]]
    alike = all((o.muscles, o.rotations) == (first.muscles, first.rotations) for o in others)
    if not alike or len(set(specimens)) == 1:
        return None
    told = tell or (lambda _: None)
    curves = Curves(fits)
    searches = [StageSearch(fits, specimens, curves, stage) for stage in STAGES]
    pairs = sorted([(s.run(), s) for s in searches], key=lambda pair: -pair[0].log_evidence)
    found, (leading, search) = [curve for curve, _ in pairs], pairs[0]
    told(0.2)
    observed, shuffled = permuted(searches, permutations, lambda done: told(0.2 + 0.6 * done))
    # A curve that each session has of its own resembles laws by chance.
    likely = leading.log_evidence >= 0.0
    laws = shared_laws(fits, specimens, leading.nodes) if likely else ()
    as_curves = np.array([search.shown_by(leading, law.changes) for law in laws]).reshape(-1, *leading.mean.shape)
    told(1.0)
    return SharedFinding(tuple(sessions), tuple(specimens), tuple(found), observed, shuffled, laws, as_curves)
