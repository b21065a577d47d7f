"""Field types of a bench session that refuse bad values in the user's words.

Each type checks what a YAML file may hold and raises a pydantic error whose context carries found, expected and remedy;
`daq.sessions.faults` puts the place in the file before it.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import date
from typing import Annotated, Any, NoReturn

from pydantic import BeforeValidator
from pydantic_core import PydanticCustomError

TENDONS = ("RI", "LU", "UI", "FDP", "FDS", "EDC")
JOINT_ANGLES = ("MCP", "PIP", "DIP", "abduction")
ROLES = ("identification", "validation")
LOCATIONS = ("tip", "bone")
OTHER_MOUNT = {"tip": "bone", "bone": "tip"}
EVENT_KINDS = ("tare", "set_posture", "move_cell", "retie", "slip", "moisten", "temperature", "note")
ROTATION_TOLERANCE = 1e-6
# No load cell tells so many N or N mm, in whatever unit its readings are; what is larger could not be squared.
LARGEST = 1e12
TELLABLE = f"a number that a load cell can tell, within ±{LARGEST:g}"
# The largest friction correction c (tension = c m g) that may be stated; noise alone can lift it above 1.
LARGEST_FACTOR = 1.5

# Names for the axes of a mount, which are proximal, dorsal, radial.
AXIS_NAMES: Mapping[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "proximal": (1.0, 0.0, 0.0),
    "distal": (-1.0, 0.0, 0.0),
    "dorsal": (0.0, 1.0, 0.0),
    "palmar": (0.0, -1.0, 0.0),
    "radial": (0.0, 0.0, 1.0),
    "ulnar": (0.0, 0.0, -1.0),
}


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return "Did you mean …?" for the nearest of the known words, or nothing."""
    lower = {k.lower(): k for k in known}
    # Exchanged letters and left-out zeros are the commonest slips, and the shortest words look alike to difflib.
    near = [k for k in lower if same_letters(k, str(word)) or _without_zeros(k) == _without_zeros(str(word))]
    near = near or difflib.get_close_matches(str(word).lower(), lower, n=1, cutoff=0.6)
    return f"Did you mean {lower[near[0]]}?" if near else ""


def same_letters(a: str, b: str) -> bool:
    """Return whether two words are the same but for case and the order of their letters."""
    return sorted(a.lower()) == sorted(b.lower())


def _without_zeros(word: str) -> str:
    """Return a word in small letters, its numbers without zeros before them."""
    return re.sub(r"(?<!\d)0+(?=\d)", "", word.lower())


def refuse(found: str, expected: str = "", remedy: str = "", at: Sequence[str | int] = ()) -> NoReturn:
    """Raise the pydantic error that the user's line is made from.

    Args:
        found: continues the name of the field, "is -3".
        expected: completes "expected …".
        remedy: a sentence, or nothing.
        at: keys or indices below the field that the fault lies at.
    """
    below = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in at)
    raise PydanticCustomError(
        "refused", "{found}", {"found": found, "expected": expected, "remedy": remedy, "below": below}
    )


def shown(value: object) -> str:
    """Return a value as a short text for a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def number(value: Any, at: Sequence[str | int] = (), unit: str = "") -> float:
    """Return a finite float from a YAML scalar; text such as 1e3, which YAML 1.1 leaves as text, counts as a number."""
    wanted = f"a number in {unit}" if unit else "a number"
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        refuse(f"is {shown(value)}", wanted, at=at)
    try:
        result = float(value)
    except (ValueError, OverflowError):
        remedy = "Write a decimal point, not a comma" if isinstance(value, str) and "," in value else ""
        refuse(f"is {shown(value)}", wanted, remedy, at=at)
    if not math.isfinite(result):
        refuse(f"is {value}", f"{wanted} that is finite", at=at)
    return result


def vector(value: Any, length: int, unit: str) -> tuple[float, ...]:
    """Return so many finite numbers."""
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != length:
        refuse(f"is {shown(value)}", f"{length} numbers in {unit}")
    numbers = tuple(number(v, [i], unit) for i, v in enumerate(value))
    for i, x in enumerate(numbers):
        if abs(x) > LARGEST:
            refuse(f"is {x:g}", f"a number in {unit} within ±{LARGEST:g}", at=[i])
    return numbers


def matrix(value: Any, unit: str) -> tuple[tuple[float, ...], ...]:
    """Return a 3 × 3 matrix of finite numbers."""
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != 3:
        refuse(f"is {shown(value)}", f"3 rows of 3 numbers ({unit})")
    rows = []
    for i, row in enumerate(value):
        if isinstance(row, str) or not isinstance(row, Sequence) or len(row) != 3:
            refuse(f"is {shown(row)}", f"3 numbers ({unit})", at=[i])
        rows.append(tuple(number(v, [i, j], unit) for j, v in enumerate(row)))
    return tuple(rows)


def _window(value: Any) -> tuple[float, float]:
    wanted = "[start, end] in s"
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != 2:
        refuse(f"is {shown(value)}", f"two times, {wanted}")
    start, end = (number(v, [i], "s") for i, v in enumerate(value))
    if end <= start:
        refuse(
            f"is [{start:g}, {end:g}]", f"{wanted} with the end after the start", "Exchange them" if end < start else ""
        )
    return start, end


def _masses(value: Any) -> dict[str, float]:
    if not isinstance(value, Mapping):
        refuse(f"is {shown(value)}", "the mass on each tendon in g, such as {FDP: 950}")
    out = {}
    for tendon, mass in value.items():
        if tendon not in TENDONS:
            hint = did_you_mean(str(tendon), TENDONS)
            refuse("is not a tendon", f"one of {' '.join(TENDONS)}", hint, at=[str(tendon)])
        grams = number(mass, [tendon], "g")
        if not 0.0 <= grams <= 1e6:
            refuse(f"is {grams:g}", "a mass in g that is not negative, and below a ton", at=[tendon])
        out[str(tendon)] = grams
    return out


def _rotation(value: Any) -> tuple[tuple[float, ...], ...]:
    import numpy as np

    rows = matrix(value, "cell to mount")
    r = np.array(rows)
    wanted = "a proper rotation, orthonormal with determinant +1"
    if float(np.abs(r @ r.T - np.eye(3)).max()) > ROTATION_TOLERANCE:
        worst = float(np.abs(r @ r.T - np.eye(3)).max())
        refuse(f"is not orthonormal (off by {worst:.2g})", wanted, "Give more digits, or use rotation_deg")
    if float(np.linalg.det(r)) < 0.0:
        refuse("has determinant -1", wanted, "Leave the mirror of a left hand to `side: left`")
    return rows


def _covariance(value: Any) -> tuple[tuple[float, ...], ...]:
    import numpy as np

    rows = matrix(value, "N²")
    c = np.array(rows)
    scale = float(np.abs(c).max()) or 1.0
    if scale > LARGEST**2:
        refuse(f"is {shown(value)}", f"numbers in N² within ±{LARGEST**2:g}")
    if float(np.abs(c - c.T).max()) > 1e-9 * scale or float(np.linalg.eigvalsh(c).min()) < 1e-9 * scale:
        refuse(f"is {shown(value)}", "a symmetric matrix in N² that takes the force for exact in no direction")
    return rows


def _spread(value: Any) -> tuple[float, ...]:
    numbers = (number(value, unit="N"),) * 3 if not isinstance(value, Sequence | Mapping) else vector(value, 3, "N")
    if min(numbers) <= 0.0 or max(numbers) > LARGEST:
        wanted = f"standard uncertainties in N above zero and up to {LARGEST:g}, one or one an axis"
        refuse(f"is {shown(value)}", wanted)
    return numbers


def _direction(value: Any) -> tuple[float, ...]:
    wanted = "3 numbers in the mount's axes, or one of +x -x +y -y +z -z proximal distal dorsal palmar radial ulnar"
    if isinstance(value, str):
        name = value.strip().lower()
        sign = -1.0 if name.startswith("-") else 1.0
        axis = AXIS_NAMES.get(name.lstrip("+-"))
        if axis is None:
            refuse(f"is {shown(value)}", wanted)
        return tuple(sign * a for a in axis)
    if not isinstance(value, Sequence) or len(value) != 3:
        refuse(f"is {shown(value)}", wanted)
    numbers = vector(value, 3, "the mount's axes")
    length = math.sqrt(sum(a * a for a in numbers))
    if length < 1e-9:
        refuse("has no length", wanted)
    return tuple(a / length for a in numbers) if abs(length - 1.0) > 1e-12 else numbers


def direction_words(value: Any) -> str:
    """Return a direction in a mount's axes as the axis's name, or as numbers along proximal, dorsal and radial."""
    found = _direction(value)
    # One letter is an axis, a word says which way.
    named = (name for name, axis in AXIS_NAMES.items() if len(name) > 1 and axis == tuple(found))
    return next(named, f"along ({', '.join(f'{a:.3g}' for a in found)})")


def _angles(value: Any) -> tuple[float, ...]:
    numbers = vector(value, 3, "degrees")
    if max(abs(a) for a in numbers) > 360.0:
        refuse(f"is {shown(value)}", "three angles within ±360 degrees")
    return numbers


def _word(value: Any, wanted: str = "a name") -> str:
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, bool) or not isinstance(value, str | int | float) or not str(value).strip():
        refuse(f"is {shown(value)}", wanted, "Put yes, no, on or off in quotes" if isinstance(value, bool) else "")
    return str(value)


def _whole(value: Any) -> int:
    amount = number(value)
    if amount != int(amount) or amount < 0:
        refuse(f"is {shown(value)}", "a whole number from 0 up")
    return int(amount)


def one_of(*known: str) -> BeforeValidator:
    """Return a validator for a fixed set of words, with a suggestion for a near miss."""

    def validate(value: Any) -> Any:
        if value not in known:
            hint = did_you_mean(str(value), known)
            refuse(f"is {shown(value)}", f"one of {' '.join(known)}", hint)
        return value

    return BeforeValidator(validate)


def within(low: float, high: float, expected: str) -> BeforeValidator:
    """Return a validator for a number in (low, high]."""

    def validate(value: Any) -> float:
        x = number(value)
        if not low < x <= high:
            refuse(f"is {x:g}", expected)
        return x

    return BeforeValidator(validate)


def _of(check: Callable[..., Any], *arguments: Any) -> BeforeValidator:
    return BeforeValidator(lambda value: check(value, *arguments))


Triple = tuple[float, float, float]
Word = Annotated[str, _of(_word)]
Reason = Annotated[str, _of(_word, "a reason in words")]
Whole = Annotated[int, _of(_whole)]
Number = Annotated[float, _of(number)]
Window = Annotated[tuple[float, float], _of(_window)]
Masses = Annotated[dict[str, float], _of(_masses)]
ForceVector = Annotated[Triple, _of(vector, 3, "N")]
TorqueVector = Annotated[Triple, _of(vector, 3, "N mm")]
OffsetVector = Annotated[Triple, _of(vector, 3, "mm")]
Angles = Annotated[Triple, _of(_angles)]
Rotation = Annotated[tuple[Triple, Triple, Triple], _of(_rotation)]
Covariance3 = Annotated[tuple[Triple, Triple, Triple], _of(_covariance)]
Spread = Annotated[Triple, _of(_spread)]
Direction = Annotated[Triple, _of(_direction)]
