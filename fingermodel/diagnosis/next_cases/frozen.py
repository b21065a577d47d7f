"""Predictions that are written down before the case is measured, and held against it afterwards.

What confirms a finding is not that it fits, but that a load case of a new mounting, setting or session comes out as it
said before, and not as its rivals said. The file carries a fingerprint of its own content.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtrc

from daq.documents import unique_keys
from daq.errors import ModelError
from daq.files import replacing
from daq.quoting import counted
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.next_cases.next_cases import BOTH, Plan
from fingermodel.diagnosis.verdict.predictive import log_normal

FORMAT = "fingertwin-frozen/1"
# A prediction holds unless noise would be further away once in a hundred times …
HOLDS = 0.01
# … and speaks for itself if it is this many times as probable as its best rival's.
CLEAR_RATIO = 20.0


@dataclass(frozen=True)
class Confirmation:
    """What the frozen cases said once they were measured."""

    confirmed: bool | None  # True, False, or None where no frozen case was measured or it does not decide
    text: str  # one plain sentence
    cases: tuple[str, ...]  # ids of the cases that were scored


def freeze(
    plan: Plan,
    session: str,
    specimen: str,
    model: str,
    readings_sha256: str | None,
    known: Sequence[str],
    held: Sequence[str] = (),
) -> dict[str, Any]:
    """Write down what each live explanation predicts for the planned cases.

    Args:
        plan: of `plan_next`.
        session: id.
        specimen: id.
        model: id of the revision or finger.
        readings_sha256: of the readings that the plan rests on.
        known: ids of the cases measured already.
        held: parameters of effects that the model holds; the explanations add to them.
    """
    body: dict[str, Any] = {
        "format": FORMAT,
        "frozen_utc": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
        "session": session,
        "specimen": specimen,
        "model": model,
        "held": list(held),
        "readings_sha256": readings_sha256,
        "known_cases": list(known),
        "explanations": plan.explanations,
        "cases": [
            c.case.as_dict()
            | {
                "predictions": {
                    name: {"mean": mean.tolist(), "covariance": covariance.tolist()}
                    for name, (mean, covariance) in c.predictions.items()
                }
            }
            for c in plan.cases
        ],
    }
    return body | {"sha256": _digest(body)}


def write_frozen(document: Mapping[str, Any], path: Path) -> None:
    """Write frozen predictions; an existing file is never overwritten.

    Raises:
        ModelError: the file exists.
    """
    if path.exists():
        raise ModelError(f"{path} exists", "a new file: frozen predictions are never overwritten")
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def read_frozen(path: Path) -> dict[str, Any]:
    """Read frozen predictions.

    Raises:
        ModelError: not such a file, or one that was changed after it was written.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=unique_keys)
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ModelError(
            f"{path.name} cannot be read ({error})", f"{FORMAT}, as `fingertwin next --freeze` writes"
        ) from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ModelError(f"{path.name} is no {FORMAT}", "a file of `fingertwin next --freeze`")
    body = {k: v for k, v in document.items() if k != "sha256"}
    if document.get("sha256") != _digest(body):
        raise ModelError(f"{path.name} was changed after it was frozen", "the file as it was written", "Freeze anew")
    return document


def score(
    document: Mapping[str, Any], finding: str, session: str, observations: Observations, held: Sequence[str] = ()
) -> Confirmation:
    """Hold frozen predictions against cases measured since.

    A finding is held against what goes without it: with something more it predicts nearly the same.

    Args:
        document: of `read_frozen`.
        finding: name of the explanation that is to be confirmed.
        session: id of the session measured.
        observations: of that session.
        held: parameters of effects that the model holds in which it was found.
    """
    if set(held) != set(document.get("held", ())):
        return Confirmation(None, f"what was frozen adds to {document['model']}, which holds other effects", ())
    if finding not in document["explanations"]:
        return Confirmation(None, f"nothing was frozen for {finding}", ())
    known = set(document["known_cases"]) if document["session"] == session else set()
    logs: dict[str, float] = dict.fromkeys(document["explanations"], 0.0)
    distance, freedom, used = 0.0, 0, []
    for frozen in document["cases"]:
        for i, case in enumerate(observations.ids):
            if case in known or observations.roles[i] == "check" or not _same(frozen, observations, i):
                continue
            used.append(case)
            for name, predicted in frozen["predictions"].items():
                mean, covariance = np.array(predicted["mean"]), np.array(predicted["covariance"])
                y = observations.wrench[i, [0, 1, 2, 5][: len(mean)]]
                seen = np.isfinite(y)
                log, z2 = log_normal((y - mean)[seen], covariance[np.ix_(seen, seen)])
                logs[name] += log
                if name == finding:
                    distance += z2
                    freedom += int(seen.sum())
    if not used:
        return Confirmation(None, "no frozen case has been measured yet", ())
    holds = float(chdtrc(freedom, distance)) >= HOLDS
    without = [n for n in logs if not set(finding.split(BOTH)) <= set(n.split(BOTH))]
    if not without:
        return Confirmation(None, f"nothing was frozen without {finding}", tuple(used))
    rival = max(without, key=lambda n: logs[n])
    ratio = logs[finding] - logs[rival]
    cases = f"{counted(len(used), 'case')} predicted on {document['frozen_utc']}"
    if holds and ratio >= np.log(CLEAR_RATIO):
        text = f"{cases} came out as {finding} said, and not as {rival} said"
        return Confirmation(True, text, tuple(used))
    if not holds and ratio < 0.0:
        text = f"{cases} came out otherwise than {finding} said; {rival} was nearer"
        return Confirmation(False, text, tuple(used))
    text = f"{cases} {'does' if len(used) == 1 else 'do'} not decide between {finding} and {rival}"
    return Confirmation(None, text, tuple(used))


def _same(frozen: Mapping[str, Any], observations: Observations, i: int) -> bool:
    return (
        observations.postures[i] == frozen["posture"]
        and observations.locations[i] == frozen["location"]
        and observations.masses_g[i].keys() == frozen["masses_g"].keys()
        and all(abs(observations.masses_g[i][m] - g) <= 0.01 * g for m, g in frozen["masses_g"].items())
    )


def _digest(body: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
