"""What an inverse analysis of a session says: forces with their uncertainty, beside what really hung."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Assigned:
    """A force with its standard deviation [N], and what really pulled; for a contact, what the model makes of that."""

    force_N: float
    sd_N: float
    hung_N: float | None

    def as_dict(self) -> dict[str, float | None]:
        """Return plain data."""
        return {"force_N": self.force_N, "sd_N": self.sd_N, "hung_N": self.hung_N}


@dataclass(frozen=True)
class InvertedCase:
    """What a closure assigns to one load case.

    Attributes:
        id: of the case.
        role: identification or validation.
        posture: its name.
        masses_g: that hung on the tendons.
        muscles: by the closure's names; `hung_N` is what hung on all that the name stands for.
        slips: every tendon and slip of the hood; `hung_N` is None.
        contacts: magnitude by joint; `hung_N` is what the model makes of the weights that hung.
        contacts_N: vector by joint, child bone on its parent, parent's axes.
        pushes: muscles that the closure asks to push.
        unbalanced_Nmm: norm of the torque that no tensions that pull can make.
        unread: components that the clamp carries and that were not read, so that they may take any value.
    """

    id: str
    role: str
    posture: str
    masses_g: dict[str, float]
    muscles: dict[str, Assigned]
    slips: dict[str, Assigned]
    contacts: dict[str, Assigned]
    contacts_N: dict[str, list[float]]
    pushes: tuple[str, ...]
    unbalanced_Nmm: float
    unread: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        forces = {
            key: {name: a.as_dict() for name, a in getattr(self, key).items()}
            for key in ("muscles", "slips", "contacts")
        }
        return {
            "id": self.id,
            "role": self.role,
            "posture": self.posture,
            "masses_g": self.masses_g,
            **forces,
            "contacts_N": self.contacts_N,
            "pushes": list(self.pushes),
            "unbalanced_Nmm": self.unbalanced_Nmm,
            "unread": list(self.unread),
        }


@dataclass(frozen=True)
class MuscleSummary:
    """How a closure did on one muscle over the cases.

    Attributes:
        name: of the muscle.
        merged: the finger's muscles that it stands for.
        rms_error_N: root mean square of assigned less hung.
        within_2sd: cases in which the two differ by no more than two standard deviations of both.
        pushes: cases in which it is asked to push.
        pushes_beyond_2sd: those in which zero is more than two standard deviations away.
    """

    name: str
    merged: tuple[str, ...]
    rms_error_N: float
    within_2sd: int
    pushes: int
    pushes_beyond_2sd: int


@dataclass(frozen=True)
class Inversion:
    """A session under one closure.

    Attributes:
        closure: its name.
        title: what it is.
        cases: at the tip, with what the closure needs of the clamp's load.
        muscles: how it did on each.
        found: cases in which it found every muscle's load within two standard deviations.
        left_out: ids of cases at the tip of which too little was read.
        notes: what the reader should know.
    """

    closure: str
    title: str
    cases: tuple[InvertedCase, ...]
    muscles: tuple[MuscleSummary, ...]
    found: int
    left_out: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "closure": self.closure,
            "closure_title": self.title,
            "cases": [c.as_dict() for c in self.cases],
            "muscles": [dict(m.__dict__) for m in self.muscles],
            "found": self.found,
            "left_out": list(self.left_out),
            "inversion_notes": list(self.notes),
        }

    def verdicts(self) -> list[str]:
        """What came of it, in sentences."""
        count = len(self.cases)
        out = [f"In {self.found} of {count} cases the load that really hung is found within two sd on every muscle."]
        out += [
            f"The closure asks {m.name} to push in {m.pushes} of {count} cases "
            f"({m.pushes_beyond_2sd} by more than two sd): no muscle can."
            for m in self.muscles
            if m.pushes
        ]
        return out
