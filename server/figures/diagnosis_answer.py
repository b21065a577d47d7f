"""Reading the answer of a diagnosis: what may be absent is found absent, and names are written for reading."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import Any, Literal

from server.figures.style import TENDONS, fixed, in_order, number

Answer = Mapping[str, Any]

NOTHING, ELSE = "nothing missing", "something else"
WILDCARD = "none_of_catalogue"
# Below this an effect's typical size hides in noise and budget.
DETECTABLE = 2.0
# From this correlation on, two effects are one class.
CONFOUNDED = 0.9
# Colours of what is missing, of nothing, and of something else.
EFFECT_COLOR, NOTHING_COLOR, ELSE_COLOR = "#0072B2", "#7f7f7f", "#E69F00"
BETTER, WORSE = "#0072B2", "#D55E00"
_LOCATIONS = ("tip", "bone")
_SHORT = {w.lower(): w for name in TENDONS for w in name.split("+") if w.isupper()}
_SHORT |= {w.lower(): w for w in ("MCP", "PIP", "DIP")}


def value(found: Any) -> float | None:
    """Return a finite number, or None for whatever else stands there."""
    # NumPy's numbers count too, for an answer that was not yet written to a file.
    if isinstance(found, bool) or not isinstance(found, Real):
        return None
    return float(found) if math.isfinite(found) else None


def vector(found: Any) -> list[float] | None:
    """Return a list of finite numbers, or None."""
    if not isinstance(found, Sequence) or isinstance(found, str) or not found:
        return None
    values = [value(v) for v in found]
    numbers = [v for v in values if v is not None]
    return numbers if len(numbers) == len(values) else None


def part(answer: Answer, *keys: str) -> Answer:
    """Return the mapping under nested keys, an empty one where there is none."""
    found: Any = answer
    for key in keys:
        found = found.get(key) if isinstance(found, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def rows(answer: Answer, *keys: str) -> list[Answer]:
    """Return the list of mappings under nested keys, an empty one where there is none."""
    found = part(answer, *keys[:-1]).get(keys[-1])
    return [row for row in found if isinstance(row, Mapping)] if isinstance(found, list | tuple) else []


def words(found: Any) -> list[str]:
    """Return a list of texts; one text alone counts as a list of it."""
    if isinstance(found, str):
        return [found] if found else []
    return [str(w) for w in found if w is not None] if isinstance(found, list | tuple) else []


def text(row: Answer, key: str, otherwise: str = "") -> str:
    """Return what stands under a key as a text, or something else where that is nothing."""
    return str(row.get(key) or otherwise)


def shown(row: Answer, key: str, digits: int = 2) -> str:
    """Write the number under a key, a dash where there is none."""
    return number(value(row.get(key)), digits)


def masses_of(row: Answer) -> dict[str, float]:
    """Return the weights [g] by tendon, as far as they are known."""
    return {str(k): m for k, v in part(row, "masses_g").items() if (m := value(v)) is not None}


def shortened(text: str, most: int) -> str:
    """Return a text that fits beside a figure; what is cut off is marked by an ellipsis. Not escaped."""
    whole = " ".join(text.split())
    return whole if len(whole) <= most else f"{whole[: most - 1].rstrip()}…"


def after_which_fit(answer: Answer) -> str:
    """Say after which fit the residuals under `where` are: `after a refit with nothing added, without c010`."""
    where = part(answer, "where")
    added, apart = [effect_name(n) for n in words(where.get("added"))], words(where.get("without"))
    without = f", without {', '.join(apart)}" if apart else ""
    return f"after a refit with {' + '.join(added) or 'nothing'} added{without}"


def muscles_of(row: Answer) -> str:
    """Return the loaded tendons as `FDP+FDS`."""
    return "+".join(words(row.get("muscles"))) or "none"


def in_tendon_order(names: Iterable[str]) -> list[str]:
    """Sort tendons as the palette does, also in the combinations that it does not know."""
    order = {name: i for i, name in enumerate(in_order([*TENDONS]))}

    def place(name: str) -> tuple[int, list[int]]:
        single = name.split("+")
        return len(single), [order.get(one, len(order)) for one in single]

    return sorted(dict.fromkeys(names), key=place)


def locations_in_order(names: Iterable[str]) -> list[str]:
    """Sort mounts: tip, bone, then others as they came."""
    present = list(dict.fromkeys(names))
    return sorted(present, key=lambda n: _LOCATIONS.index(n) if n in _LOCATIONS else len(_LOCATIONS))


def mount_name(location: str) -> str:
    """Write a mount for a heading; without one, cases of all."""
    return f"Cell at the {location}" if location else "All cases"


def plane_of(answer: Answer) -> Literal["sagittal", "space"]:
    """Return the plane in which errors are drawn: that in which the finger is judged, else space."""
    return "sagittal" if answer.get("judged_in") == "sagittal" else "space"


def summary_rmse(answer: Answer, when: str) -> dict[str, float]:
    """Return the RMSE [N] of `before` or `after` by role and location (`validation/tip`)."""
    found = {str(k): value(part(v, plane_of(answer)).get("rmse_N")) for k, v in part(answer, when).items()}
    return {k: v for k, v in found.items() if v is not None}


def effect_name(name: str) -> str:
    """Write an effect's or a parameter's name for reading: `worn_pulley.FDP` as `worn pulley FDP`."""
    if name == WILDCARD:
        return ELSE
    base, *places = str(name).split(".")
    spoken = " ".join(_SHORT.get(w, w) for w in base.split("_") if w)
    return " ".join([spoken.replace("FDP FDS", "FDP–FDS"), *places])


def kind(row: Answer) -> str:
    """Say what a row of the ranking stands for: `effects`, `nothing` or `else`."""
    effects = words(row.get("effects"))
    if not effects:
        return "nothing"
    return "else" if effects == [WILDCARD] else "effects"


def explanation_name(row: Answer) -> str:
    """Name a row of the ranking: its candidates, or its effects each with the place that the variant says."""
    which = kind(row)
    if which != "effects":
        return NOTHING if which == "nothing" else ELSE
    effects, candidates = words(row.get("effects")), words(row.get("candidates"))
    if candidates:
        return " + ".join(effect_name(c) for c in candidates)
    variant = [v.strip() for text in words(row.get("variant")) for v in re.split(r"[+,]", text) if v.strip()]
    named, rest = [], [v for v in variant if v not in effects]
    for effect in effects:
        own = [v for v in rest if v.startswith(f"{effect}.")]
        rest = [v for v in rest if v not in own]
        named += own or [effect]
    text = " + ".join(effect_name(n) for n in named)
    return f"{text} ({', '.join(effect_name(r) for r in rest)})" if rest else text


def ranked(answer: Answer) -> list[Answer]:
    """Return the ranking, most probable first; what has no probability comes last in its order."""
    return sorted(rows(answer, "ranking"), key=lambda r: -(value(r.get("probability")) or 0.0))


def named_rows(answer: Answer) -> list[Answer]:
    """Return the rows of the ranking that the verdict names."""
    verdict, order = answer.get("verdict"), ranked(answer)
    # Candidates say more than effects do: which pulley, which mount.
    key = "candidates" if words(answer.get("candidates")) else "effects"
    names = words(answer.get(key))
    if verdict == "found":
        return [r for r in order if sorted(words(r.get(key))) == sorted(names)][:1]
    if verdict == "one_of":
        best: dict[str, Answer] = {}
        for row in order:
            if len(own := words(row.get(key))) == 1 and own[0] in names:
                best.setdefault(own[0], row)
        return list(best.values())
    wanted = {"nothing_missing": "nothing", "none_of_catalogue": "else"}.get(str(verdict))
    return [r for r in order if kind(r) == wanted][:1]


def probability_text(found: Any) -> str:
    """Write a probability; beyond three decimals only that it is beyond them. Not escaped."""
    p = value(found)
    if p is None:
        return "–"
    if p < 0.001 or p > 0.999:
        return "<0.001" if p < 0.001 else ">0.999"
    return fixed(p, 2 if 0.01 <= p <= 0.99 else 3)


def signed(found: Any, digits: int = 1) -> str:
    """Write a number with its sign, such as `+12.0`."""
    v = value(found)
    return number(v, digits) if v is None or v <= 0 else f"+{number(v, digits)}"


def from_to(before: Any, after: Any, digits: int = 3) -> str:
    """Write `0.170 → 0.030`; a dash where neither or only what was before is known."""
    if value(after) is None:
        return "–"
    return f"{number(value(before), digits)} → {number(value(after), digits)}"


def change_text(before: float, after: float, digits: int = 3) -> str:
    """Write a change with its sign and so many decimals, however small it is."""
    text = fixed(after - before, digits)
    return f"+{text}" if after > before and text.strip("0.") else text


def gains_of(row: Answer) -> tuple[str, str, str]:
    """Write what an explanation gains: ln evidence, RMSE of the validation cases before and after, and its size."""
    held = part(row, "validation_rmse_N")
    return signed(row.get("log_evidence_gain")), from_to(held.get("before"), held.get("after")), size_text(row)


def size_text(row: Answer) -> str:
    """Write how far an explanation moves the readings [N], with its interval: `0.19 (0.17–0.21)`."""
    size, low, high = (value(row.get(k)) for k in ("size_N", "size_low_N", "size_high_N"))
    if size is None:
        return "–"
    return number(size) if low is None or high is None else f"{number(size)} ({number(low)}–{number(high)})"


def with_sd(found: Any, sd: Any) -> tuple[str, str]:
    """Write a value and its standard deviation with as many decimals as two digits of the latter need."""
    v, s = value(found), value(sd)
    if v is None or not s:
        return "–" if v is None else f"{v:.4g}".replace("-", "\N{MINUS SIGN}"), number(s)
    digits = max(0, 1 - math.floor(math.log10(abs(s))))
    return (fixed(v, digits), fixed(s, digits)) if digits < 8 else (f"{v:.3g}", f"{s:.2g}")
