"""How many further load cases a name needs until it is sure, each chosen by the plan: on the independent simulator.

    python -m benchmarks.further_cases [--sessions 120] [--first 1000] [--most 6] [--out FILE]

Sessions with one effect whose true name has not the probability 0.95 after their protocol are carried on: the best case
of `next` is measured on the same rig, the posture set anew, and the session diagnosed again. Writes
`benchmarks/further_cases.md`.
"""

from __future__ import annotations

import argparse
import datetime as dt
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.machine import commit
from benchmarks.recovery import protocol_of

HERE = Path(__file__).parent
SURE = 0.95


def carry_on(seed: int, most: int) -> dict[str, Any]:
    """Diagnose a session, and measure what the plan offers until the true name is sure."""
    from fingermodel.diagnosis.diagnose import diagnose
    from fingermodel.diagnosis.next_cases.next_cases import plan_next
    from fingermodel.session import Session
    from tests.simulator import draw_session, draw_truth

    effects, _ = draw_truth("one", seed)
    (name,) = effects
    further: list[tuple[str, str, dict[str, float]]] = []
    track: list[float] = []
    why = "sure"
    while True:
        with tempfile.TemporaryDirectory() as folder:
            draw_session(Path(folder), seed, effects, protocol=protocol_of(seed), further=further)
            bench = Session.open(folder)
            found = diagnose(bench.model, bench.observations)
        true = name.split(".")[0]
        track.append(sum(p for n, p in found.posterior.inclusion.items() if n in (name, true)))
        if track[-1] >= SURE:
            break
        if len(further) == most:
            why = "not sure"
            break
        plan = plan_next(found)
        if not plan.cases:
            why = f"{found.verdict.kind}: no case offered"
            break
        case = plan.cases[0].case
        further.append((case.posture, case.location, case.masses_g))
    return {"seed": seed, "truth": name, "track": track, "cases": len(further), "why": why}


def report(rows: list[dict[str, Any]], command: str) -> str:
    """The figures as Markdown."""
    at_once = [r for r in rows if r["cases"] == 0 and r["why"] == "sure"]
    later = sorted(r["cases"] for r in rows if r["cases"] and r["why"] == "sure")
    never = [r for r in rows if r["why"] != "sure"]
    lines = [
        "# Further load cases until the true name is sure",
        "",
        f"Made by `{command}` on {dt.datetime.now(dt.UTC).date()}, commit {commit()}; {len(rows)} sessions.",
        f"Sure: the true effect has a probability of {SURE} or more. Each case is the plan's best, on the same rig.",
        "",
        "| | sessions |",
        "|---|---|",
        f"| sure after the protocol | {len(at_once)} |",
        *(f"| after {n} further case{'s' if n > 1 else ''} | {later.count(n)} |" for n in dict.fromkeys(later)),
        f"| not sure | {len(never)} |",
        "",
        "| seed | truth | probability after 0, 1, … further cases | ended |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {r['seed']} | {r['truth']} | {', '.join(f'{p:.2f}' for p in r['track'])} | {r['why']} |"
        for r in rows
        if r["cases"] or r["why"] != "sure"
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=120)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--most", type=int, default=6)
    parser.add_argument("--out", type=Path, default=HERE / "further_cases.md")
    given = parser.parse_args()
    rows = []
    for seed in range(given.first, given.first + given.sessions):
        rows.append(carry_on(seed, given.most))
        print(rows[-1], flush=True)
    command = f"python -m benchmarks.further_cases --sessions {given.sessions} --first {given.first}"
    command += f" --most {given.most}"
    given.out.write_text(report(rows, command), encoding="utf-8")


if __name__ == "__main__":
    main()
