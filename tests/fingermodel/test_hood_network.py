"""Laws of the elastic hood: equilibrium, least energy, work, scale, symmetry, slopes, and its limit of fixed shares."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.effects.hood_shift import HoodShift
from fingermodel.exchange.sharing import segment_shares
from fingermodel.extensor import segment_tensions
from fingermodel.finger_files import finger_document, finger_from_dict, read_finger
from fingermodel.fingers import Finger
from fingermodel.hood.elastic import home, shape_of
from fingermodel.hood.equilibrium import equilibria, least_energy, settle
from fingermodel.hood.network import Shape, displacements, energy
from fingermodel.hood.parts import ElasticHood
from fingermodel.hood.sharing import bone_lengths, hood_state, slip_excursions
from fingermodel.kinematics import joint_poses
from fingermodel.model import ANY_LAYOUT, jax_values, posture_moment_arms, with_anatomy
from fingermodel.statics import clamp_forces, joint_torques
from fingermodel.tendons import joint_pulls

Floats = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)
CASES = 16
FINGER = read_finger("synek2019_network")
assert isinstance(FINGER.topology.hood, ElasticHood)
HOOD = FINGER.topology.hood
NETWORK = HOOD.network
MIRROR = {"F": "L", "G": "M", "H": "N", "L": "F", "M": "G", "N": "H"}


def draw(seed: int) -> tuple[Shape, Floats]:
    """Shapes and pulls of `CASES` networks: other stiffness, slack that the posture leaves, and muscles that rest."""
    rng = np.random.default_rng(seed)
    fraction = np.array([1.0, 1.0, *rng.uniform(0.2, 0.8, 2), rng.uniform(0.99, 1.0)])
    crosses = np.array([bool(s) for s in HOOD.slips])
    length = jnp.asarray(bone_lengths(FINGER.topology, jax_values(FINGER.values)))
    one = shape_of(HOOD, length, jnp.asarray(crosses * rng.uniform(0.0, 5.0)), jnp.asarray(fraction))
    shape = Shape(*(jnp.broadcast_to(x, (CASES, *x.shape)) for x in one))
    tension = rng.uniform(0.0, 100.0, (CASES, 4)) * (rng.random((CASES, 4)) < 0.7)
    pulls = np.zeros((CASES, len(NETWORK.nodes), 2))
    for column, (_, node, along, around) in zip(tension.T, HOOD.pulls, strict=True):
        pulls[:, node] += column[:, None] * np.array([along, around])
    return shape, pulls


def first(shape: Shape) -> Shape:
    return Shape(*(x[0] for x in shape))


@given(seed=seeds)
@settings(max_examples=20)
def test_every_free_node_is_in_equilibrium(seed: int) -> None:
    """Summed up node by node from the tensions, without the code that settles them."""
    shape, pulls = draw(seed)
    found = equilibria(NETWORK, shape, jnp.asarray(pulls))
    ways = np.asarray(found.ways)
    for case in range(CASES):
        force = pulls[case].copy()
        for i, (distal, proximal) in enumerate(NETWORK.ends):
            moved = np.zeros((len(NETWORK.nodes), 2))
            for way, node in enumerate(NETWORK.moves):
                moved[node] += np.asarray(shape.slide)[case, way] * ways[case, way]
            line = np.asarray(shape.span)[case, i] + moved[proximal] - moved[distal]
            pull = np.asarray(found.springs.tension)[case, i] * line / np.linalg.norm(line)
            force[distal] += pull
            force[proximal] -= pull
        for way, node in enumerate(NETWORK.moves):
            left = force[node] @ np.asarray(shape.slide)[case, way] - float(shape.tether[case]) * ways[case, way]
            assert abs(left) < 1e-8


@given(seed=seeds)
@settings(max_examples=10)
def test_no_displacement_lowers_the_energy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape, pulls = draw(seed)
    found = equilibria(NETWORK, shape, jnp.asarray(pulls))
    off = rng.normal(size=found.ways.shape) * 10.0 ** rng.uniform(-4, 0.5, (CASES, 1))
    least, other = (_energies(shape, jnp.asarray(pulls), found.ways + d) for d in (0.0, off))
    assert np.all(np.asarray(other) > np.asarray(least))


@given(seed=seeds)
@settings(max_examples=10)
def test_a_slack_spring_carries_exactly_nothing_and_a_taut_one_its_stiffness(seed: int) -> None:
    shape, pulls = draw(seed)
    springs = equilibria(NETWORK, shape, jnp.asarray(pulls)).springs
    tension, elongation = np.asarray(springs.tension), np.asarray(springs.elongation)
    slack = elongation <= 0.0
    assert slack.any()
    assert (tension[slack] == 0.0).all()
    assert_allclose(tension[~slack], (np.asarray(shape.stiffness) * elongation)[~slack], rtol=1e-14)


@given(seed=seeds, scale=st.floats(0.1, 10.0))
@settings(max_examples=10)
def test_stiffness_and_pulls_that_grow_alike_leave_the_geometry(seed: int, scale: float) -> None:
    shape, pulls = draw(seed)
    more = shape._replace(stiffness=shape.stiffness * scale, tether=shape.tether * scale)
    once = equilibria(NETWORK, shape, jnp.asarray(pulls))
    scaled = equilibria(NETWORK, more, jnp.asarray(pulls * scale))
    assert_allclose(np.asarray(scaled.ways), np.asarray(once.ways), atol=1e-8)
    assert_allclose(np.asarray(scaled.springs.tension), scale * np.asarray(once.springs.tension), atol=1e-6)


@pytest.mark.full
def test_pulls_store_the_work_that_they_do() -> None:
    """Along a path of growing pulls, which begins where no spring is taut and passes springs that tighten."""
    shape, pulls = draw(4)
    one, full, steps = first(shape), pulls[0] + pulls[1], 2048
    path = np.linspace(0.0, 1.0, steps + 1)[:, None, None] * full * np.linspace(0.3, 1.0, steps + 1)[:, None, None]
    many = Shape(*(jnp.broadcast_to(x, (steps + 1, *x.shape)) for x in one))
    found = equilibria(NETWORK, many, jnp.asarray(path))
    moved = np.asarray(jax.vmap(partial(displacements, NETWORK))(many, found.ways))
    work = np.sum(0.5 * (path[1:] + path[:-1]) * (moved[1:] - moved[:-1]))
    stored = np.asarray(_energies(many, jnp.zeros_like(jnp.asarray(path)), found.ways))
    assert stored[-1] > 1.0
    assert_allclose(work, stored[-1] - stored[0], rtol=1e-6)


def test_radial_and_ulnar_exchanged_give_the_mirrored_forces() -> None:
    shape, pulls = draw(7)
    names = [MIRROR.get(n, n) for n in NETWORK.nodes]
    node = [NETWORK.nodes.index(n) for n in names]
    ends = [{NETWORK.nodes[i] for i in e} for e in NETWORK.ends]
    spring = [ends.index({MIRROR.get(n, n) for n in e}) for e in ends]
    swapped = shape._replace(stiffness=shape.stiffness[:, np.array(spring)])
    mirrored = pulls[:, node] * np.array([1.0, -1.0])
    once = equilibria(NETWORK, shape, jnp.asarray(pulls)).springs.tension
    other = equilibria(NETWORK, swapped, jnp.asarray(mirrored)).springs.tension
    assert_allclose(np.asarray(other), np.asarray(once)[:, spring], atol=1e-7)
    assert not np.allclose(np.asarray(once), np.asarray(once)[:, spring], atol=1.0)


def test_scipy_finds_no_lower_energy() -> None:
    from scipy.optimize import minimize

    shape, pulls = draw(11)
    found = equilibria(NETWORK, shape, jnp.asarray(pulls))
    value = jax.jit(jax.value_and_grad(partial(energy, NETWORK), argnums=2))
    for case in range(3):
        one, pull = Shape(*(x[case] for x in shape)), jnp.asarray(pulls[case])
        start = np.zeros(len(NETWORK.moves))

        def total(w: Floats, shape: Shape = one, pull: jax.Array = pull) -> tuple[float, Floats]:
            stored, slope = value(shape, pull, jnp.asarray(w))
            return float(stored), np.asarray(slope)

        theirs = minimize(total, start, args=(), method="BFGS", jac=True)
        ours = float(value(one, pull, found.ways[case])[0])
        assert ours <= theirs.fun + 1e-9
        assert ours == pytest.approx(theirs.fun, abs=1e-4)


@pytest.mark.full
@given(seed=seeds)
@settings(max_examples=8)
def test_slopes_of_the_equilibrium_are_those_of_finite_differences(seed: int) -> None:
    shape, pulls = draw(seed)
    rng = np.random.default_rng(seed)
    one, pull = first(shape), jnp.asarray(pulls[0] + 10.0 * np.abs(pulls[1]))
    change = Shape(
        *(jnp.asarray(rng.normal(size=x.shape)) * w for x, w in zip(one, (1e-2, 1e-3, 10, 1e-2, 0), strict=True))
    )
    more = jnp.asarray(rng.normal(size=pull.shape))
    _, slope = _slopes((one, pull), (change, more))
    step = 1e-6
    ends = [
        _settled(Shape(*(x + k * dx for x, dx in zip(one, change, strict=True))), pull + k * more)
        for k in (-step, step)
    ]
    numeric = (np.asarray(ends[1]) - np.asarray(ends[0])) / (2 * step)
    assert_allclose(np.asarray(slope), numeric, atol=1e-5 * (1.0 + np.abs(numeric).max()))


@pytest.mark.full
def test_excursion_falls_by_the_moment_arm_where_tendons_wrap_and_where_they_run_straight() -> None:
    topology, values = FINGER.topology, jax_values(FINGER.values)
    slips = ("ES", "RB", "UB", "TE")

    @jax.jit
    def excursions(q: jax.Array) -> jax.Array:
        return slip_excursions(topology, values, joint_poses(topology, values, q), slips)

    slope = jax.jit(jax.jacobian(excursions))
    names = [s.name for s in topology.segments]
    columns = [names.index(n) for n in ("PIP.ES", "PIP.RB", "PIP.UB", "DIP.TE")]
    assert_allclose(np.asarray(excursions(jnp.zeros(4))), 0.0, atol=1e-12)
    for posture in ([0.1, 0.4, 0.9, 0.5], [0.0, -0.2, -0.2, -0.1]):
        q = jnp.asarray(posture)
        arms = np.asarray(posture_moment_arms(topology, values, q))[:, columns]
        assert_allclose(np.asarray(slope(q)), -arms.T, atol=1e-10)


def test_torque_of_the_slips_is_minus_the_slope_of_the_least_energy() -> None:
    """With rest lengths that do not follow the posture the hood is a conservative system under dead loads."""
    topology = FINGER.topology
    values = jax_values(FINGER.values)._replace(fraction=jnp.asarray([1.0, 1.0, 0.5, 0.5, 0.0]))
    muscle = dict(zip(topology.muscles, jnp.asarray([3.0, 2.0, 5.0, 0.0, 0.0, 20.0]), strict=True))

    @jax.jit
    @partial(jax.value_and_grad, has_aux=True)
    def stored(q: jax.Array) -> tuple[jax.Array, dict[str, jax.Array]]:
        state = hood_state(topology, values, muscle, joint_poses(topology, values, q))
        return least_energy(NETWORK, state.shape, state.pulls), state.slips

    q = jnp.asarray([0.0, 0.3, 0.02, 0.03])
    (_, slips), slope = stored(q)
    pulled = np.array([float(slips.get(s.slip, 0.0)) for s in topology.segments])
    torque = np.asarray(posture_moment_arms(topology, values, q)) @ pulled
    assert np.abs(torque).max() > 10.0
    assert_allclose(torque, -np.asarray(slope), atol=1e-6)


def test_slopes_of_the_clamped_finger_reach_through_the_hood() -> None:
    """Reverse mode, as refits have it: tendon points, fractions, postures and tensions against finite differences."""
    topology, values, rng = FINGER.topology, jax_values(FINGER.values), np.random.default_rng(6)
    anatomy = np.concatenate([np.ravel(x) for x in (values.proximal_point, values.distal_point, values.fraction)])
    parts = [anatomy, np.array([0.05, 0.4, 0.7, 0.3]), np.array([6.0, 3.0, 8.0, 5.0, 4.0, 7.0])]
    ends, weights = np.cumsum([len(p) for p in parts])[:-1], jnp.asarray(rng.normal(size=6))

    @jax.jit
    @jax.value_and_grad
    def weighed(z: jax.Array) -> jax.Array:
        theta, posture, tension = jnp.split(z, ends)
        own = with_anatomy(topology, values, theta)
        poses = joint_poses(topology, own, posture)
        segments = segment_tensions(topology, own, tension, poses)
        torque = joint_torques(poses, joint_pulls(topology, own, poses), segments)
        return weights @ clamp_forces(topology, own, poses, tension, torque).tip

    at, step = np.concatenate(parts), 1e-5
    slope = np.asarray(weighed(jnp.asarray(at))[1])
    first_fraction = len(anatomy) - len(topology.fractions)
    assert np.abs(slope[first_fraction + 2 : first_fraction + 4]).min() > 0.01
    for _ in range(5):
        along = rng.normal(size=len(at)) * np.where(np.arange(len(at)) < first_fraction, 1.0, 0.1)
        low, high = (float(weighed(jnp.asarray(at + k * along))[0]) for k in (-step, step))
        assert_allclose(slope @ along, (high - low) / (2.0 * step), rtol=1e-6, atol=1e-7)


@given(seed=seeds)
@settings(max_examples=10)
def test_what_enters_the_hood_crosses_the_joints(seed: int) -> None:
    """Nodes slide along the bones, so bands and central slip carry all pulls, and the terminal slip both bands."""
    rng = np.random.default_rng(seed)
    tension = rng.uniform(0.0, 9.0, 6)
    slips = {s.slip: float(t) for s, t in zip(FINGER.topology.segments, _shared(FINGER, tension), strict=True)}
    enters = sum(tension[FINGER.topology.muscles.index(m)] for m in HOOD.members)
    assert slips["ES"] + slips["RB"] + slips["UB"] == pytest.approx(enters, abs=1e-2)
    assert slips["TE"] == pytest.approx(slips["RB"] + slips["UB"], abs=1e-2)


@pytest.mark.parametrize(
    "stiffness",
    [pytest.param(1e3, marks=pytest.mark.full), pytest.param(1e5, marks=pytest.mark.full), 1e7],
    ids=["soft", "stiff", "rigid"],
)
def test_a_rigid_rhombus_shares_by_fixed_fractions(stiffness: float) -> None:
    """Springs that fork from each muscle to both slips, laid out so that equilibrium alone tells the shares."""
    base = read_finger("an1979_middle")
    network, fractions = _rhombus(base, stiffness)
    fixed = base.replace_values(fraction=[fractions[n] for n in base.topology.fractions])
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(6):
        tension = rng.uniform(1.0, 9.0, 6)
        # A bent PIP joint would turn the springs across it, and with them the shares.
        posture = np.array([rng.uniform(-0.5, 0.5), 0.1, 0.0, rng.uniform(0.0, 0.8)])
        worst = max(worst, np.abs(_shared(network, tension, posture) - _shared(fixed, tension, posture)).max())
    assert worst < 1e3 / stiffness
    if stiffness == 1e7:
        assert worst < 1e-4


def test_half_of_a_muscle_that_inserts_at_the_bone_does_not_enter() -> None:
    tension = np.array([4.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    half = FINGER.replace_values(fraction=[0.5, 1.0, 0.5, 0.5, 1.0])
    slips = [i for i, s in enumerate(FINGER.topology.segments) if s.slip in ("ES", "RB", "UB", "TE")]
    assert_allclose(_shared(half, tension)[slips], _shared(FINGER, 0.5 * tension)[slips], atol=1e-12)


def test_a_hood_scales_with_its_finger() -> None:
    topology = FINGER.topology
    length = bone_lengths(topology, jax_values(FINGER.values))
    assert_allclose(np.asarray(home(HOOD, 2.0 * length)), 2.0 * np.asarray(home(HOOD, length)))


def test_a_written_finger_keeps_its_network() -> None:
    fitted = FINGER.replace_values(fraction=[1.0, 1.0, 0.6, 0.4, 1.0])
    document = finger_document(replace(fitted, id="mine"), "fit", "a fit", "fitted")
    again = finger_from_dict(yaml.safe_load(yaml.safe_dump(document, sort_keys=False)), "mine.yaml")
    assert again.topology == FINGER.topology
    assert_allclose(again.values.fraction, fitted.values.fraction)


def test_effects_on_fixed_fractions_have_nothing_to_act_on() -> None:
    assert HoodShift().parameters(FINGER.topology, ANY_LAYOUT) == ()


def test_a_finger_with_fixed_fractions_does_without_the_network() -> None:
    """Neither imported nor traced: such fingers start as soon as before."""
    said = (
        "import sys; import fingermodel.model; from fingermodel.finger_files import read_finger; "
        "finger = read_finger('an1979_middle'); values = fingermodel.model.jax_values(finger.values); "
        "fingermodel.extensor.segment_tensions(finger.topology, values, values.suture[:, 0]); "
        "print(sorted(m for m in sys.modules if m.startswith('fingermodel.hood.')))"
    )
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)  # noqa: S603 - ours
    assert done.stdout.strip() == "['fingermodel.hood.files', 'fingermodel.hood.parts']"


def test_no_shares_are_written_for_a_hood_that_has_none() -> None:
    assert segment_shares(FINGER) is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"network": "hu2014"}, "Did you mean hu2014b_index"),
        ({"network": "../hoods/hu2014b_index.yaml"}, "no hood"),
        ({"pulls": {"RI": "D", "LU": "G", "UI": "N", "EDC": "A"}}, "RI pulls at 'D'"),
        ({"pulls": {"RI": "H", "LU": "G", "UI": "N", "EIP": "A"}}, "EIP"),
        ({"partial": ["FDP"]}, "hood.partial"),
        ({"fractions": {}}, "hood.fractions has \\[\\]"),
        ({"kind": "web"}, "kind"),
    ],
    ids=["unknown hood", "hood elsewhere", "fixed node", "unknown muscle", "partial", "fractions", "kind"],
)
def test_a_wrong_hood_is_refused_in_one_line(change: dict[str, Any], said: str) -> None:
    document = _document("synek2019_network")
    document["hood"] |= change
    with pytest.raises(ModelError, match=said) as fault:
        finger_from_dict(document, "mine.yaml")
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (("springs", 0, "ends"), ["E", "Z"], "spring EOE joins E and Z"),
        (("springs", 0, "ends"), ["C", "E0"], "crosses two joints"),
        (("springs", 0, "stiffness_N_per_mm"), -1.0, "greater than 0"),
        (("delivers", "central_slip"), ["AB"], "times in delivers"),
        (("nodes", 0, "bone"), "MC", "node A lies on 'MC'"),
        (("nodes", 0, "slides_deg"), [10.0, 190.0], "slides twice one way"),
        (("nodes", 0, "source"), "nobody", "source 'nobody' is not listed"),
        (("groups", "medial_slips"), ["XY"], "groups.medial_slips has"),
    ],
    ids=["node", "two joints", "stiffness", "delivers", "bone", "slides", "source", "group"],
)
def test_a_wrong_network_is_refused_in_one_line(place: tuple[Any, ...], value: object, said: str) -> None:
    document = _document("synek2019_network")
    network = yaml.safe_load((data_dir() / "hoods" / "hu2014b_index.yaml").read_text(encoding="utf-8"))
    block = network
    for key in place[:-1]:
        block = block[key]
    block[place[-1]] = value
    document["hood"]["network"] = network
    with pytest.raises(ModelError, match=said) as fault:
        finger_from_dict(document, "mine.yaml")
    assert "\n" not in str(fault.value)


@partial(jax.jit)
def _energies(shape: Shape, pulls: jax.Array, ways: jax.Array) -> jax.Array:
    return jax.vmap(partial(energy, NETWORK))(shape, pulls, ways)


@jax.jit
def _settled(shape: Shape, pulls: jax.Array) -> jax.Array:
    return settle(NETWORK, shape, pulls)


@jax.jit
def _slopes(primals: tuple[Shape, jax.Array], tangents: tuple[Shape, jax.Array]) -> tuple[jax.Array, jax.Array]:
    return jax.jvp(partial(settle, NETWORK), primals, tangents)


@partial(jax.jit, static_argnums=0)
def _segments(topology: Any, values: Any, tension: jax.Array, posture: jax.Array) -> jax.Array:
    return segment_tensions(topology, values, tension, joint_poses(topology, values, posture))


def _shared(finger: Finger, tension: Floats, posture: Floats | None = None) -> Floats:
    q = np.array([0.0, 0.2, 0.6, 0.3]) if posture is None else posture
    return np.asarray(_segments(finger.topology, jax_values(finger.values), jnp.asarray(tension), jnp.asarray(q)))


def _document(name: str) -> dict[str, Any]:
    text = (data_dir() / "fingers" / f"{name}.yaml").read_text(encoding="utf-8")
    document: dict[str, Any] = yaml.safe_load(text)
    return document


def _rhombus(base: Finger, stiffness: float) -> tuple[Finger, dict[str, float]]:
    """`base` with a forked network, and the fractions of Winslow's rhombus that this one tends to."""
    a_long, g_long, d_long, f_long, side = 0.2, 0.5, 0.2, 0.4, 0.2
    own = {"source": "us", "certainty": "assumed"}

    def node(name: str, bone: str, along: float, around: float, slides: list[float]) -> dict[str, Any]:
        return {"name": name, "bone": bone, "along": along, "around": around, "slides_deg": slides} | own

    def spring(a: str, b: str, k: float) -> dict[str, Any]:
        return {"name": f"{a}-{b}", "ends": [a, b], "stiffness_N_per_mm": k} | own

    lengths = np.asarray(bone_lengths(base.topology, jax_values(base.values)))
    pp, mp = lengths[1], lengths[2]
    wide = 2.0 * side * pp / mp
    nodes = [node("A", "PP", a_long, 0.0, [0.0]), node("D", "MP", d_long, 0.0, []), node("E0", "DP", 0.1, 0.0, [])]
    nodes += [node("G", "PP", g_long, side, [0.0, 90.0]), node("M", "PP", g_long, -side, [0.0, 90.0])]
    nodes += [node("F", "MP", f_long, wide, [0.0]), node("L", "MP", f_long, -wide, [0.0])]
    forks = [spring(a, b, stiffness) for a, b in ("AD", "AF", "AL", "GD", "GF", "MD", "ML")]
    trunks = [spring("F", "E0", stiffness**2), spring("L", "E0", stiffness**2)]
    roles = {"central_slip": ["A-D", "G-D", "M-D"], "radial_band": ["A-F", "G-F"], "ulnar_band": ["A-L", "M-L"]}
    network = {
        "format": "hood/1",
        "id": "rhombus",
        "title": "a rhombus",
        "sources": {"us": "ours"},
        "bones": ["PP", "MP", "DP"],
        "nodes": nodes,
        "springs": [*forks, *trunks],
        "tether": {"stiffness_N_per_mm": 1e-6} | own,
        "delivers": roles | {"terminal_slip": ["F-E0", "L-E0"]},
    }
    document = _document("an1979_middle")
    slips = {k: v for k, v in document["hood"].items() if k.endswith(("slip", "band"))}
    number = {"value": 1.0, "source": "fingertwin", "certainty": "assumed"}
    pulls = {"RI": "G", "LU": "G", "UI": "M", "EDC": "A"}
    document["hood"] = {"kind": "elastic_network", "network": network, "pulls": pulls, "fractions": {"follow": number}}
    document["hood"] |= slips
    # G between two strands: their parts across the finger cancel. A: what its spring to the slip takes of all three.
    to_slip = side * pp / ((1 - g_long) * pp + d_long * mp)
    to_band = side * pp / ((1 - g_long) * pp + f_long * mp)
    central = to_band / (to_slip + to_band)
    square = 1.0 / (1.0 + (2.0 * side * pp / ((1 - a_long) * pp + f_long * mp)) ** 2)
    # Springs of one stiffness: the central one moves with A, the askew ones by the cosine of their angle.
    extensor = 1.0 / (1.0 + 2.0 * square)
    fractions = {f"{m}_ES": central for m in ("RI", "LU", "UI")} | {"EDC_ES": extensor, "RI_EM": 1.0, "UI_EM": 1.0}
    return finger_from_dict(document, "rhombus.yaml"), fractions
