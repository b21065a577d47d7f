"""Draw what is hidden in a session, and write the session that it leads to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

# Importing them enters their effects.
from tests.simulator import bone_effects, cell_effects, tendon_effects  # noqa: F401
from tests.simulator import outside as _outside  # noqa: F401
from tests.simulator.finger import Floats
from tests.simulator.protocols import PROTOCOLS, Protocol
from tests.simulator.recording import record, write_session
from tests.simulator.rig import Acting, Rig, acting, draw_rig, read_cases, wander
from tests.simulator.situation import CATALOGUE, OUTSIDE, Effect, Size, sizes_of

Kind = Literal["none", "one", "two", "outside"]
# How far what is outside the catalogue changes the force components, RMS over the cases that it touches [N].
OUTSIDE_RMS_N = (0.1, 0.5)


class Hidden(NamedTuple):
    """What to hide in a session: in the order of `draw_session`'s arguments."""

    effects: dict[str, Size]
    outside: str | None


@dataclass(frozen=True, eq=False)
class Truth:
    """What a session was made with.

    Attributes:
        seed: of everything that was drawn.
        protocol: dev, short or three_levels.
        effects: names of the catalogue that act.
        sizes: by `effect.place`, or `effect` where it has one place, in the catalogue's units; also of what is outside.
        outside: what acts that is not in the catalogue.
        nuisance_scale: specimen and rig are off by this much of the budget.
        noise_N: white noise of one force reading.
        wrench: (6,) by case, as a cell without noise reads it, tare removed [N, N mm].
        plain: the same of this specimen and rig, had nothing acted.
        change_N: RMS over all force components of what the effects change.
        change_where_it_acts_N: the same over the cases in which anything changes (by a tenth of the largest change).
    """

    seed: int
    protocol: str
    effects: tuple[str, ...]
    sizes: dict[str, float]
    outside: str | None
    nuisance_scale: float
    noise_N: float
    wrench: dict[str, Floats]
    plain: dict[str, Floats]
    change_N: float
    change_where_it_acts_N: float


def draw_truth(kind: Kind, seed: int) -> Hidden:
    """Draw what to hide: nothing, one or two effects of the catalogue, or something outside it.

    The largest component of a size is 30 to 100 % of the plausible range, with either sign where the range has both;
    the other components are anything up to that. One tendon's pulley is worn; one mount's zero is off.
    """
    rng = np.random.default_rng([seed, 5])
    if kind == "outside":
        return Hidden({}, str(rng.choice(list(OUTSIDE))))
    count = {"none": 0, "one": 1, "two": 2}[kind]
    chosen = [str(n) for n in rng.choice(list(CATALOGUE), count, replace=False)]
    return Hidden(dict(_drawn(CATALOGUE[name], rng) for name in chosen), None)


def _drawn(effect: Effect, rng: np.random.Generator) -> tuple[str, Size]:
    name, places = effect.name, len(effect.places)
    if name == "worn_pulley":
        name, places = f"{name}.{rng.choice(effect.places)}", 1
    if name == "zero_offset":
        name, places = f"{name}.{rng.choice(['tip', 'bone'])}", 3
    parts = rng.uniform(0.0, 1.0, places)
    parts *= rng.uniform(0.3, 1.0) / parts.max()
    if effect.low < 0.0:
        parts *= rng.choice([-1.0, 1.0], places)
    size = tuple((effect.high * parts).tolist())
    return name, size[0] if places == 1 else size


def draw_session(
    folder: Path,
    seed: int,
    effects: Mapping[str, Size] | None = None,
    outside: str | None = None,
    protocol: str = "dev",
    nuisance_scale: float | None = None,
    further: Sequence[tuple[str, str, Mapping[str, float]]] = (),
    done: Callable[[Protocol], tuple[Protocol, Protocol]] | None = None,
    unforeseen: Sequence[Acting] = (),
) -> Truth:
    """Write `session.yaml` and `readings.parquet` of a test on a specimen of its own.

    Specimen, rig and noise depend on the seed, the protocol and the scale alone, so sessions of one seed differ by
    their effects only.

    Args:
        folder: to write into; made where it does not exist.
        seed: of everything that is drawn.
        effects: sizes by name of the catalogue, or `name.place` (see `sizes_of`), in the catalogue's units.
        outside: name of something outside the catalogue; its size is drawn so that it changes the force components by
            0.1 to 0.5 N RMS where it acts, or by as much of that as its own range allows.
        protocol: dev, short or three_levels.
        nuisance_scale: specimen and rig against the budget; by default drawn from 0.5 to 2.
        further: identification cases after the protocol's end (posture, location, masses [g]), each in a posture set
            anew; the readings before them stay as they were.
        done: gives what is done and what the session states, of the protocol; see `slips`.
        unforeseen: what acts as well and is in no list.
    """
    if protocol not in PROTOCOLS:
        raise KeyError(f"{protocol} is none of {', '.join(PROTOCOLS)}")
    if outside is not None and outside not in OUTSIDE:
        raise KeyError(f"{outside} is none of {', '.join(OUTSIDE)}")
    plan = PROTOCOLS[protocol]()
    rng = np.random.default_rng([seed, 0])
    drawn_scale, noise_N = float(2.0 ** rng.uniform(-1.0, 1.0)), float(rng.uniform(0.02, 0.05))
    share = float(rng.uniform())
    scale = drawn_scale if nuisance_scale is None else float(nuisance_scale)
    bare = draw_rig(plan, seed, scale)
    if further:
        plan = plan.with_further(further)
        bare = bare.with_settings(plan, seed, scale)
    plan, stated = (plan, plan) if done is None else done(plan)
    sizes = sizes_of(effects or {})
    rig = bare.with_effects(acting(CATALOGUE[n], sizes[n], seed) for n in CATALOGUE if n in sizes)
    plain = read_cases(bare, plan)
    rig = rig.with_effects(unforeseen)
    loads = read_cases(rig, plan) if sizes or unforeseen else plain
    named = {
        f"{n}.{place}" if place else n: float(x)
        for n, size in sizes.items()
        for place, x in zip(CATALOGUE[n].places, size, strict=True)
        if x != 0.0
    }
    if outside is not None:
        named[outside], loads = _of_a_size(rig, plan, OUTSIDE[outside], seed, share, loads)
    folder.mkdir(parents=True, exist_ok=True)
    wrench = record(folder, plan, loads, lambda t: wander(rig, t, plan.end_s), noise_N, seed)
    write_session(folder, stated, f"SIM-{seed:05d}")
    ids = [c.id for c in plan.cases]
    return Truth(
        seed=seed,
        protocol=protocol,
        effects=tuple(sizes),
        sizes=named,
        outside=outside,
        nuisance_scale=scale,
        noise_N=noise_N,
        wrench=dict(zip(ids, wrench, strict=True)),
        plain=dict(zip(ids, plain, strict=True)),
        change_N=float(np.sqrt(np.mean((wrench - plain)[:, :3] ** 2))),
        change_where_it_acts_N=_touched_rms(wrench - plain),
    )


def _of_a_size(
    rig: Rig, plan: Protocol, effect: Effect, seed: int, share: float, loads: Floats
) -> tuple[float, Floats]:
    """Find the size within the effect's range whose change of the forces is the wanted one.

    Args:
        rig: without the effect.
        plan: the protocol.
        effect: from outside the catalogue.
        seed: of the session.
        share: of the way from the least to the largest change that is wanted.
        loads: (cases, 6) without the effect.

    Returns:
        The size, and (cases, 6) with it.
    """

    def tried(size: float) -> tuple[Floats, float]:
        changed = read_cases(rig.with_effects([acting(effect, np.array([size]), seed)]), plan)
        return changed, _touched_rms(changed - loads)

    low, size = effect.low, effect.high
    changed, reached = tried(size)
    most = min(reached, OUTSIDE_RMS_N[1])
    least = min(OUTSIDE_RMS_N[0], 0.5 * most)
    wanted = least + share * (most - least)
    high = size
    for _ in range(8):
        if abs(reached - wanted) < 0.05 * wanted:
            break
        low, high = (size, high) if reached < wanted else (low, size)
        straight = size * wanted / reached if reached > 0.0 else high
        # In proportion where that stays well inside, else halfway by ratio.
        inside = low * 1.02 < straight < high / 1.02
        size = straight if inside else float(np.sqrt(low * high))
        changed, reached = tried(size)
    return size, changed


def _touched_rms(change: Floats) -> float:
    size = np.linalg.norm(change[:, :3], axis=1)
    touched = change[size > 0.1 * max(float(size.max()), 1e-12), :3]
    return float(np.sqrt(np.mean(touched**2))) if touched.size else 0.0
