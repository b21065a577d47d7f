"""A bench session (`bench-session/1`) as frozen records.

Frames: x proximal, y dorsal, z radial; at `tip` the axes of the distal phalanx, at `bone` those of the metacarpal. A
force is what the finger exerts on the cell. Flexion is positive. Keys that these records do not know are kept and
reported where they can do no harm (session, load case, load cell, event, environment) and refused elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PrivateAttr, model_validator

from daq.sessions.rules import faults_between
from daq.vocabulary import (
    EVENT_KINDS,
    JOINT_ANGLES,
    LARGEST_FACTOR,
    LOCATIONS,
    ROLES,
    Angles,
    Covariance3,
    Direction,
    ForceVector,
    Masses,
    Number,
    OffsetVector,
    Reason,
    Rotation,
    Spread,
    TorqueVector,
    Whole,
    Window,
    Word,
    did_you_mean,
    number,
    one_of,
    refuse,
    same_letters,
    shown,
    within,
)

FORMAT = "bench-session/1"
Location = Literal["tip", "bone"]


class Strict(BaseModel):
    """A record whose unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Open(BaseModel):
    """A record whose unknown keys are kept, and reported by `fingertwin check`."""

    model_config = ConfigDict(frozen=True, extra="allow")

    def unknown_keys(self) -> dict[str, str]:
        """Return each unknown key with the known key that it may stand for, or nothing."""
        known = type(self).model_fields
        return {key: did_you_mean(key, known) for key in self.model_extra or {}}


class Specimen(Strict):
    """The cadaver finger, under a pseudonym. Unknown keys are refused, so that no name or donor number slips in."""

    id: Word
    species: Word
    digit: Word
    side: Annotated[Literal["left", "right"], one_of("left", "right")]
    sex: Word | None = None
    age_band: Word | None = None
    preservation: Word | None = None
    freeze_thaw_cycles: Whole | None = None
    contralateral_of: Word | None = None
    ethics_ref: Word | None = None


class Mount(Strict):
    """Mount of the cell at one location.

    Attributes:
        frame: the bone whose axes the readings end in.
        rotation: (3, 3) cell to mount; without one the readings are already in right-hand-equivalent mount axes.
        rotation_deg: the same as intrinsic x-y-z angles [deg].
        offset_mm: (3,) d of T' = R (T − d × F), the load point seen from the cell's origin in the cell's axes [mm].
    """

    frame: Word | None = None
    rotation: Rotation | None = None
    rotation_deg: Angles | None = None
    offset_mm: OffsetVector | None = None

    @model_validator(mode="after")
    def _one_rotation(self) -> Mount:
        if self.rotation is not None and self.rotation_deg is not None:
            refuse("has both rotation and rotation_deg", "one of them", "Remove the one that is not from the drawing")
        return self


class LoadCell(Open):
    """The load cell and its mounts."""

    model: Word | None = None
    rate_hz: Annotated[float, within(0.0, 1e6, "a sampling rate in Hz above zero")] | None = None
    serial: Word | None = None
    calibration: Word | None = None
    mounts: dict[Annotated[Location, one_of(*LOCATIONS)], Mount] = Field(default_factory=dict)


class Posture(BaseModel):
    """Joint angles [deg], flexion positive.

    MCP, PIP and DIP are required, unless the posture names joints of another finger; those are kept by their names.
    """

    model_config = ConfigDict(frozen=True, extra="allow")

    MCP: Number = 0.0
    PIP: Number = 0.0
    DIP: Number = 0.0
    abduction: Number = 0.0

    @model_validator(mode="before")
    @classmethod
    def _angles(cls, value: Any) -> Any:
        wanted = "joint angles in degrees, such as {MCP: 40, PIP: 55, DIP: 35, abduction: 0}"
        if isinstance(value, Posture):
            return value
        if not isinstance(value, Mapping):
            refuse(f"is {value!r}", wanted)
        angles = {str(k): number(v, [str(k)], "degrees") for k, v in value.items()}
        for name, angle in angles.items():
            if abs(angle) > 180.0:
                refuse(f"is {angle:g}", "an angle within ±180 degrees", at=[name])
        missing = [j for j in JOINT_ANGLES[:3] if j not in angles]
        if missing and not set(angles) - set(JOINT_ANGLES):
            refuse(f"lacks {' '.join(missing)}", wanted)
        for name in set(angles) - set(JOINT_ANGLES):
            meant = [j for j in missing if same_letters(j, name)]
            hint = f"Did you mean {meant[0]}?" if meant else did_you_mean(name, JOINT_ANGLES[3:])
            if hint:
                refuse("is not a joint angle", f"one of {' '.join(JOINT_ANGLES)}", hint, at=[name])
        return angles


class LoadCase(Open):
    """Weights on tendons in one posture, and where the resulting force is read.

    Attributes:
        masses_g: mass hung on each tendon [g].
        unloaded_s: window of the tare reading, before; loaded_s: of the loaded one; unloaded_after_s: of a second tare.
        force_N: (3,) averaged force [N, mount frame] instead of windows.
        setting: number of times the posture was set anew; mounting: the cell or clamp moved.
        force_sd_N: (3,) standard uncertainty of `force_N`; force_cov_N2: its covariance.
        torque_Nmm: (3,) averaged torque about the mount's origin.
        excluded: why the case is left out.
    """

    id: Word
    role: Annotated[Literal["identification", "validation"], one_of(*ROLES)]
    posture: Word
    location: Annotated[Location, one_of(*LOCATIONS)]
    masses_g: Masses
    unloaded_s: Window | None = None
    loaded_s: Window | None = None
    unloaded_after_s: Window | None = None
    force_N: ForceVector | None = None
    setting: Whole = 0
    mounting: Whole = 0
    repeat_of: Word | None = None
    direction: Annotated[Literal["loading", "unloading"], one_of("loading", "unloading")] = "loading"
    unloaded_state: (
        Annotated[Literal["slack", "hanger_on", "preload"], one_of("slack", "hanger_on", "preload")] | None
    ) = None
    force_sd_N: Spread | None = None
    force_cov_N2: Covariance3 | None = None
    torque_Nmm: TorqueVector | None = None
    excluded: Reason | None = None
    note: Word | None = None

    @property
    def recorded(self) -> bool:
        """True if the case is a pair of windows in the readings."""
        return self.loaded_s is not None

    def windows(self) -> Iterator[tuple[str, tuple[float, float]]]:
        """Yield the name and limits [s] of each window."""
        for name in ("unloaded_s", "loaded_s", "unloaded_after_s"):
            window = getattr(self, name)
            if window is not None:
                yield name, window

    @model_validator(mode="after")
    def _windows_or_force(self) -> LoadCase:
        both = "unloaded_s and loaded_s of a recording, or force_N"
        if self.force_N is not None and next(self.windows(), None) is not None:
            refuse("has both windows and force_N", f"either {both}", "Remove one of the two")
        if self.force_N is None and (self.loaded_s is None or self.unloaded_s is None):
            lacks = [k for k in ("unloaded_s", "loaded_s") if getattr(self, k) is None]
            refuse(f"has neither force_N nor {' nor '.join(lacks)}" if len(lacks) == 2 else f"lacks {lacks[0]}", both)
        if self.force_sd_N is not None and self.force_cov_N2 is not None:
            refuse("has both force_sd_N and force_cov_N2", "one of them")
        after, loaded = self.unloaded_after_s, self.loaded_s
        if after is not None and loaded is not None and after[0] + after[1] <= loaded[0] + loaded[1]:
            refuse("has an unloaded_after_s before loaded_s", "a second tare after the load", "Exchange the windows")
        return self


class KnownWeight(Strict):
    """A known weight hung on the cell itself.

    Attributes:
        direction: (3,) unit vector of the weight's pull on the cell, in the mount's axes.
    """

    when: Annotated[Literal["before", "during", "after"], one_of("before", "during", "after")]
    mount: Annotated[Location, one_of(*LOCATIONS)]
    mass_g: Annotated[float, within(0.0, 1e6, "a mass in g above zero, and below a ton")]
    direction: Direction
    unloaded_s: Window
    loaded_s: Window
    note: Word | None = None


class Event(Open):
    """Something that happened at the bench."""

    t_s: Number
    kind: Annotated[str, one_of(*EVENT_KINDS)]
    value: Any = None
    text: str | None = None


class Environment(Open):
    """Temperatures, and when the specimen was thawed."""

    room_C: Number | None = None
    cell_C: Number | None = None
    thawed_utc: Word | None = None


class TensionEstimate(Strict):
    """The friction correction is to be found from the session's own force balance."""

    estimate: Literal["force_balance"]


def _tension_factor(value: Any) -> Any:
    wanted = f"the friction correction c, 0 < c ≤ {LARGEST_FACTOR}, or {{estimate: force_balance}}"
    if isinstance(value, TensionEstimate):
        return value
    if isinstance(value, Mapping):
        if dict(value) != {"estimate": "force_balance"}:
            refuse(f"is {shown(dict(value))}", wanted)
        return TensionEstimate(estimate="force_balance")
    factor = number(value)
    if not 0.0 < factor <= LARGEST_FACTOR:
        refuse(f"is {factor:g}", wanted)
    return factor


def _named_or_spelled_out(value: Any) -> Any:
    if value is not None and not isinstance(value, str | Mapping):
        refuse(f"is {value!r}", "a name, or its values by key")
    return value


def _format(value: Any) -> Any:
    if value != FORMAT:
        refuse(f"is {value!r}", f"{FORMAT!r}", "Convert the session, or correct the tag")
    return value


def _some(value: Any) -> Any:
    if not isinstance(value, list | tuple):
        refuse(f"is {shown(value)}", "a list of load cases")
    if not value:
        refuse("is empty", "at least one load case")
    return value


# Of a load case, what an amendment may set anew.
AMENDABLE = ("masses_g", "posture", "location", "excluded")


class Amendment(Strict):
    """Amendment of a load case that was entered wrongly; the entry itself stays as it is.

    Attributes:
        case: its id.
        masses_g: what hung [g], instead of what was entered.
        posture: in which.
        location: of the cell.
        excluded: why the case is left out.
        why: how it is known.
        at: when it was amended (ISO 8601).
        by: who did.
    """

    case: Word
    masses_g: Masses | None = None
    posture: Word | None = None
    location: Annotated[Location, one_of(*LOCATIONS)] | None = None
    excluded: Reason | None = None
    why: Reason
    at: Word
    by: Word | None = None

    @model_validator(mode="after")
    def _changes_something(self) -> Amendment:
        if not self.changes:
            refuse("changes nothing", f"one of {' '.join(AMENDABLE)}")
        return self

    @property
    def changes(self) -> dict[str, Any]:
        """Values in place of the entry, by the key of the case."""
        values = {name: getattr(self, name) for name in AMENDABLE}
        return {name: value for name, value in values.items() if value is not None}


class Session(Open):
    """One bench session: what was hung, where it was read, and how.

    Attributes:
        light_masses: whether masses below 1 g are meant as they stand.
        amendments: of cases that were entered wrongly, in the order in which they were made; `amended` heeds them.
    """

    format: Annotated[str, BeforeValidator(_format)]
    id: Word
    specimen: Specimen
    finger: Word
    readings: Word | None = None
    load_cell: LoadCell | None = None
    gravity_m_s2: Annotated[float, within(5.0, 20.0, "gravity in m/s², such as 9.81")] = 9.81
    tension_factor: Annotated[float | TensionEstimate, BeforeValidator(_tension_factor)]
    postures_deg: dict[Word, Posture]
    cases: Annotated[tuple[LoadCase, ...], BeforeValidator(_some)]
    checks: tuple[KnownWeight, ...] = ()
    events: tuple[Event, ...] = ()
    environment: Environment | None = None
    budget: Annotated[str | dict[str, Any] | None, BeforeValidator(_named_or_spelled_out)] = None
    protocol: Word | None = None
    provenance: Annotated[str | dict[str, Any] | None, BeforeValidator(_named_or_spelled_out)] = None
    light_masses: bool = False
    amendments: tuple[Amendment, ...] = ()

    _folder: Path | None = PrivateAttr(default=None)
    _entered: Session | None = PrivateAttr(default=None)

    @property
    def folder(self) -> Path | None:
        """The folder that the session was read from."""
        return self._folder

    @property
    def mean_of(self) -> tuple[str, ...]:
        """Ids of the sessions that its provenance says it is the average of; none for a recording."""
        named = self.provenance.get("mean_of") if isinstance(self.provenance, Mapping) else None
        return tuple(map(str, named)) if isinstance(named, list | tuple) else ()

    @property
    def amended(self) -> Session:
        """The session with its amendments heeded; they are still listed, and heeding them twice changes nothing."""
        if not self.amendments:
            return self
        cases = {c.id: c for c in self.cases}
        for amendment in self.amendments:
            if amendment.case in cases:
                cases[amendment.case] = cases[amendment.case].model_copy(update=amendment.changes)
        out = self.model_copy(update={"cases": tuple(cases.values())})
        out._folder, out._entered = self._folder, self.entered
        return out

    @property
    def entered(self) -> Session:
        """The session as it was entered."""
        return self._entered or self

    @property
    def has_amended_entries(self) -> bool:
        """Whether amendments change what was entered, and do not leave cases out alone."""
        return any(a.changes.keys() - {"excluded"} for a in self.amendments)

    @property
    def unamended(self) -> Session:
        """The session as it was entered, without its amendments."""
        out = self.entered.model_copy(update={"amendments": ()})
        out._folder = self._folder
        return out

    @property
    def readings_path(self) -> Path | None:
        """The readings file, where the session names one and its folder is known."""
        return None if self.readings is None or self._folder is None else self._folder / self.readings

    def in_folder(self, folder: Path | None) -> Session:
        """Return the session as kept in a folder."""
        out = self.model_copy()
        out._folder = folder
        return out

    @model_validator(mode="after")
    def _hangs_together(self) -> Session:
        for fault in faults_between(self.model_dump(exclude_none=True)):
            refuse(fault.found, fault.expected, fault.remedy, fault.at)
        return self
