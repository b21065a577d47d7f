"""How often a diagnosis is right, on sessions of the independent simulator: figures with Wilson intervals.

    python -m benchmarks.recovery [--sessions 120] [--workers 2] [--kinds none,one,two,outside] [--first 9000]
                                  [--second] [--out FILE] [--resume]

The simulators (`tests/simulator` and, with `--second`, `tests/second_simulator`) share no code with the model; their
effects have other forms than the catalogue's, their small errors are 0.5 to 2 times the budget. Writes
`benchmarks/recovery.md` and keeps every session's outcome beside it, so that a run that was stopped can be resumed, or
reported as far as it went (`--resume --sessions 0`).
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.machine import commit, use_all_cores
from tests.simulator import Kind

KINDS: tuple[Kind, ...] = ("none", "one", "two", "outside")
HERE = Path(__file__).parent
# Effects that change the readings by less than this many standard uncertainties in all are not there to be found.
BINS = ((0.0, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 0.99), (0.99, 1.01))


class Drawn(NamedTuple):
    """What is hidden in a session."""

    effects: list[str]
    outside: str | None
    protocol: str
    nuisance_scale: float
    change_N: float


def draw(folder: Path, kind: Kind, seed: int, second: bool) -> Drawn:
    """Write a session of one simulator."""
    from tests.simulator import draw_session, draw_truth

    if second:
        from tests.second_simulator import write_session

        made = write_session(folder, kind, seed)
        change = sum(c**2 for c in made.rms_change_N.values()) ** 0.5
        return Drawn(sorted(made.effects), made.outside, made.protocol, made.budget_factor, change)
    effects, outside = draw_truth(kind, seed)
    truth = draw_session(folder, seed, effects, outside, protocol_of(seed))
    names = sorted({name.split(".")[0] for name in effects})
    return Drawn(names, outside, protocol_of(seed), truth.nuisance_scale, float(truth.change_N))


def one_session(kind: Kind, seed: int, second: bool = False) -> dict[str, Any]:
    """Draw a session, diagnose it, and say what came out."""
    import numpy as np

    from fingermodel.diagnosis.answer.addition import add_effects
    from fingermodel.diagnosis.answer.answer import suspects
    from fingermodel.diagnosis.diagnose import diagnose
    from fingermodel.diagnosis.verdict.verdict import stated_node
    from fingermodel.session import Session

    with tempfile.TemporaryDirectory() as folder:
        drawn = draw(Path(folder), kind, seed, second)
        bench = Session.open(folder)
        found = diagnose(bench.model, bench.observations)
        posterior = found.posterior
        ranked = sorted(posterior.fits.values(), key=lambda f: -f.log_posterior)
        singles = [f.explanation.effects[0] for f in ranked if f.explanation.size == 1]
        nothing = posterior.nothing
        true = drawn.effects
        best = found.best
        out: dict[str, Any] = {
            "kind": kind,
            "seed": seed,
            "commit": commit(),
            "protocol": drawn.protocol,
            "truth": true,
            "outside": drawn.outside,
            "nuisance_scale": drawn.nuisance_scale,
            "change_N": drawn.change_N,
            "verdict": found.verdict.kind,
            "effects": sorted(found.verdict.effects),
            "names": list(found.verdict.names),
            "probability": found.verdict.probability,
            "short": list(found.verdict.short),
            "leader": sorted(set(posterior.leader.explanation.effects)),
            "singles": list(dict.fromkeys(singles))[:3],
            "class": sorted(_class_of(found, posterior.leader.explanation.names)),
            "inclusion": dict(list(posterior.inclusion.items())[:4]),
            "p_nothing": posterior.p_nothing,
            "p_beyond": posterior.p_beyond,
            "suspects": [s["probability"] for s in suspects(found)],
            "misfit": nothing.misfit(stated_node(nothing)),
            "validation_rmse_N": found.validation_rmse(best),
            "seconds": found.seconds,
        }
        out["truth_rmse_N"] = None
        if kind in ("one", "two") and true:
            known = add_effects(bench.model, bench.observations, true, starts=1)
            from fingermodel.comparison.comparison import compare

            unseen = compare(bench.model, bench.observations, known.fit.theta).select(role="validation")
            out["truth_rmse_N"] = unseen.errors(unseen.judged_in).rmse_N
            # Of two, each must show beside the other.
            others = [add_effects(bench.model, bench.observations, [t], starts=1) for t in true if len(true) > 1]
            gains = [added.log_evidence_gain or 0.0 for added in (known, *others)]
            least = gains[0] - max(gains[1:], default=0.0)
            out["truth_gain"] = float(np.round(least, 2))
    return out


def protocol_of(seed: int) -> str:
    """Every fourth session has three levels."""
    return "three_levels" if seed % 4 == 3 else "dev"


def _class_of(found: Any, names: Sequence[str]) -> set[str]:
    by_name = {c.name: c.effect for c in found.candidates.all}
    return {by_name[a] for n in names for a in (n, *found.confounding.alike(n))}


def wilson(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's 95 % interval of a proportion."""
    if trials == 0:
        return 0.0, 1.0
    p = successes / trials
    centre = (p + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * (p * (1 - p) / trials + z * z / (4 * trials * trials)) ** 0.5
    return max(0.0, centre - half), min(1.0, centre + half)


def rate_line(words: str, chosen: Sequence[bool]) -> str:
    """A row of a table: how often something holds, with its interval and count."""
    low, high = wilson(sum(chosen), len(chosen))
    rate = f"{100 * sum(chosen) / len(chosen):.0f} %" if chosen else "none"
    return f"| {words} | {rate} | {100 * low:.0f}–{100 * high:.0f} % | {sum(chosen)}/{len(chosen)} |"


def _rate(what: str, aim: str, outcomes: Iterable[bool]) -> str:
    values = list(outcomes)
    low, high = wilson(sum(values), len(values))
    share = f"{100 * sum(values) / len(values):.1f} %" if values else "–"
    return f"| {what} | {share} | {100 * low:.1f}–{100 * high:.1f} % | {sum(values)}/{len(values)} | {aim} |"


def report(rows: Sequence[dict[str, Any]], command: str, simulator: str = "tests/simulator") -> str:
    """The figures as Markdown."""
    of = {kind: [r for r in rows if r["kind"] == kind] for kind in KINDS}
    shown = [r for r in of["one"] if r.get("truth_gain") is not None and r["truth_gain"] > 3.0]
    pairs = [r for r in of["two"] if r.get("truth_gain") is not None and r["truth_gain"] > 3.0]
    named = [r for r in rows if r["verdict"] == "found" and r["probability"] >= 0.9]
    right = [set(r["effects"]) <= set(r["truth"]) and bool(r["effects"]) for r in named]
    held = [
        r["validation_rmse_N"] <= 1.1 * r["truth_rmse_N"] + 1e-3
        for r in (*shown, *pairs)
        if r["truth_rmse_N"] and r["validation_rmse_N"]
    ]
    commits = ", ".join(dict.fromkeys(r["commit"] for r in rows))
    lines = [
        "# Recovery of known truths",
        "",
        f"Made by `{command}` on {dt.datetime.now(dt.UTC).date()}, commit {commits}; "
        f"{', '.join(f'{len(v)} sessions with {k}' for k, v in of.items() if v)}.",
        f"The sessions come from `{simulator}`: plain NumPy, no code shared with the model, other forms of every",
        "effect, small errors of 0.5 to 2 times the budget. An effect counts as shown if adding the true one gains",
        "more than 3 in log evidence (of two, each beside the other); the others changed the readings by less than",
        "noise and budget.",
        "",
        "| figure | rate | 95 % (Wilson) | count | aim |",
        "|---|---|---|---|---|",
        _rate(
            "true effect first, its class included", "95 %", (bool(set(r["truth"]) & set(r["class"])) for r in shown)
        ),
        _rate("true effect first", "", (r["truth"] == r["leader"] for r in shown)),
        _rate("true effect among the first three singles", "", (r["truth"][0] in r["singles"] for r in shown)),
        _rate("found, and right", "", (r["verdict"] == "found" and r["effects"] == r["truth"] for r in shown)),
        _rate("named with probability 0.9 or more: all names true", "98 %", right),
        _rate("nothing named where nothing is missing", "97 %", (not r["effects"] for r in of["none"])),
        _rate("`nothing_missing` said there", "", (r["verdict"] == "nothing_missing" for r in of["none"])),
        _rate("outside declared so", "85 %", (r["verdict"] == "none_of_catalogue" for r in of["outside"])),
        _rate("outside: not named as something else", "", (not r["effects"] for r in of["outside"])),
        _rate("both of two found", "80 %", (r["effects"] == r["truth"] for r in pairs)),
        _rate(
            "both of two found, where each gains more than 10 beside the other",
            "80 %",
            (r["effects"] == r["truth"] for r in pairs if r["truth_gain"] > 10.0),
        ),
        _rate("both of two lead", "", (set(r["truth"]) <= set(r["leader"]) for r in pairs)),
        _rate("validation error within 10 % of knowing the truth", "", held),
        "",
        "Reliability of the stated probability of the leading name (sessions with one effect or none):",
        "",
        "| stated | came true | sessions |",
        "|---|---|---|",
    ]
    for low, high in BINS:
        chosen = []
        for r in (*of["none"], *of["one"]):
            if r["inclusion"]:
                name, p = next(iter(r["inclusion"].items()))
                if low <= p < high:
                    chosen.append((p, name.split(".")[0] in r["truth"]))
        if chosen:
            mean = sum(p for p, _ in chosen) / len(chosen)
            lines.append(f"| {mean:.2f} | {sum(t for _, t in chosen) / len(chosen):.2f} | {len(chosen)} |")
    lines += ["", "What was missed or misread (sessions with one effect that shows):", ""]
    lines += [
        f"- seed {r['seed']} ({r['protocol']}, budget × {r['nuisance_scale']:.1f}): {r['truth'][0]} → {r['verdict']} "
        f"{' + '.join(r['effects'] or r['names'])}{'; ' + r['short'][0] if r['short'] else ''}"
        for r in shown
        if not (r["verdict"] == "found" and r["effects"] == r["truth"])
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=120)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--first", type=int, default=9000, help="seed of the first session")
    parser.add_argument("--second", action="store_true", help="sessions of the second simulator")
    parser.add_argument("--out", type=Path, default=HERE / "recovery.md")
    parser.add_argument("--resume", action="store_true", help="keep the outcomes that there are")
    given = parser.parse_args()
    use_all_cores()
    kinds = [kind for kind in KINDS if kind in given.kinds.split(",")]
    jobs = [(kind, given.first + seed, given.second) for seed in range(given.sessions) for kind in kinds]
    rows: list[dict[str, Any]] = []
    keep = given.out.with_suffix(".jsonl")
    if given.resume and keep.exists():
        rows = [json.loads(line) for line in keep.read_text(encoding="utf-8").splitlines()]
        done_before = {(r["kind"], r["seed"]) for r in rows}
        jobs = [job for job in jobs if job[:2] not in done_before]
    with ProcessPoolExecutor(given.workers) as pool, keep.open("a" if given.resume else "w", encoding="utf-8") as log:
        for done, future in enumerate(as_completed([pool.submit(one_session, *job) for job in jobs])):
            if future.exception() is not None:
                pool.shutdown(wait=False, cancel_futures=True)
            rows.append(future.result())
            log.write(json.dumps(rows[-1]) + "\n")
            log.flush()
            if done % 20 == 19:
                print(f"{done + 1} of {len(jobs)}", flush=True)
    rows.sort(key=lambda r: (KINDS.index(r["kind"]), r["seed"]))
    command = f"python -m benchmarks.recovery --sessions {given.sessions} --first {given.first} --kinds {given.kinds}"
    command += " --second" if given.second else ""
    simulator = "tests/second_simulator" if given.second else "tests/simulator"
    given.out.write_text(report(rows, command, simulator), encoding="utf-8")
    print(given.out.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
