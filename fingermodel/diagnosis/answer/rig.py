"""What the readings say of the rig, beside the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fingermodel.diagnosis.answer.where import bent
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.fitting.reading_errors import OTHER_SCATTER, other_scatter


def of_rig(d: Diagnosis, bent_most: Sequence[str]) -> dict[str, Any]:
    """Return the contract's keys of repeatability, budget, anatomy and noise.

    Args:
        d: of `diagnose`.
        bent_most: parameters of the budget that are bent most by what acts.
    """
    posterior, assumed = d.posterior, d.session.observations.noise_assumed
    repeatability: dict[str, float | None] = {f"{key}_pct": 100.0 * v for key, v in _with_sd(posterior.scatter).items()}
    repeatability["stated_pct"] = 100.0 * d.session.stated_scatter
    others = posterior.other_scatter
    for name, (key, unit, factor, *_) in OTHER_SCATTER.items():
        both = [factor * v for v in others[name]] if name in others else [None, None]
        repeatability |= dict(zip((f"{key}_{unit}", f"{key}_sd_{unit}"), both, strict=True))
    return {
        "repeatability": repeatability,
        "budget_multiple": _with_sd(posterior.budget) | {"carried_by": list(bent_most)},
        "anatomy_multiple": _with_sd(posterior.anatomy),
        "noise_multiple": _with_sd(posterior.noise if assumed else (1.0, 0.0)) | {"assumed": assumed},
        "extra_noise_N": None if assumed else _with_sd(posterior.noise),
    }


def _with_sd(of: tuple[float, float]) -> dict[str, Any]:
    return dict(zip(("value", "sd"), of, strict=True))


def remarks(d: Diagnosis) -> list[str]:
    """Say what fits hold fixed elsewhere, and what repeatability, budget, anatomy and noise the readings want."""
    out, posterior = d.session.model.parameters.fixed_elsewhere, d.posterior
    if d.faults:
        return out  # what they cause says nothing of the rig
    if d.trend and d.trend.sentence not in d.verdict.short:
        out.append(f"{d.trend.sentence}.")
    scatter, stated = posterior.scatter[0], d.session.stated_scatter
    if scatter > max(0.004, 1.5 * stated):
        than = f", where {100 * stated:.1f} % is stated" if stated else ", where none is stated"
        out.append(f"The cases repeat to {100 * scatter:.1f} % of their tensions{than}.")
    if others := other_scatter({kind: value for kind, (value, _) in posterior.other_scatter.items()}):
        out.append(f"Besides, the readings scatter by {', by '.join(others)}.")
    multiple = posterior.budget[0]
    if multiple > 1.5:
        carried = ", ".join(row["name"] for row in bent(d.session.problem, d.theta_of(d.best))[:3])
        out.append(
            f"The readings want a budget {multiple:.1f} times as large as stated"
            + (f"; it is bent most in {carried}." if carried else ".")
        )
    if posterior.anatomy[0] > 1.5:
        out.append(
            f"The specimen differs {posterior.anatomy[0]:.1f} times as much from the finger of its file as the "
            "anatomy's priors say."
        )
    if d.outliers:
        ids = ", ".join(d.session.observations.ids[case] for case in d.outliers)
        out.append(f"Not counted: {ids}, off by more than usual noise, and by less than a slip would explain.")
    noise = posterior.noise[0]
    if d.session.observations.noise_assumed:
        out.append(
            f"The readings state no uncertainty; this rests on {noise * d.session.model.budget.reading_sd_N:.3f} N a "
            "component, as the readings have it."
        )
    elif noise >= 0.002:
        out.append(f"Each reading scatters by {1000.0 * noise:.0f} mN beside the noise of its plateau and its tare.")
    return out
