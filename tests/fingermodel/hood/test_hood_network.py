"""A finger with a hood of springs: what crosses its joints, what its files hold, and which are refused."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from numpy.testing import assert_allclose

from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.effects.hood_shift import HoodShift
from fingermodel.exchange.sharing import segment_shares
from fingermodel.extensor import segment_tensions
from fingermodel.fingers.files import finger_document, finger_from_dict, read_finger
from fingermodel.hood.elastic import home
from fingermodel.hood.sharing import bone_lengths
from fingermodel.kinematics import joint_poses
from fingermodel.model import jax_values, with_anatomy
from fingermodel.statics import clamp_forces, joint_torques
from fingermodel.structure import ANY_LAYOUT
from fingermodel.tendons import joint_pulls
from tests.fingermodel.elastic_hoods import FINGER, HOOD, document_of, rhombus, seeds, shared


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
    slips = {s.slip: float(t) for s, t in zip(FINGER.topology.segments, shared(FINGER, tension), strict=True)}
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
    network, fractions = rhombus(base, stiffness)
    fixed = base.replace_values(fraction=[fractions[n] for n in base.topology.fractions])
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(6):
        tension = rng.uniform(1.0, 9.0, 6)
        # A bent PIP joint would turn the springs across it, and with them the shares.
        posture = np.array([rng.uniform(-0.5, 0.5), 0.1, 0.0, rng.uniform(0.0, 0.8)])
        worst = max(worst, np.abs(shared(network, tension, posture) - shared(fixed, tension, posture)).max())
    assert worst < 1e3 / stiffness
    if stiffness == 1e7:
        assert worst < 1e-4


def test_half_of_a_muscle_that_inserts_at_the_bone_does_not_enter() -> None:
    tension = np.array([4.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    half = FINGER.replace_values(fraction=[0.5, 1.0, 0.5, 0.5, 1.0])
    slips = [i for i, s in enumerate(FINGER.topology.segments) if s.slip in ("ES", "RB", "UB", "TE")]
    assert_allclose(shared(half, tension)[slips], shared(FINGER, 0.5 * tension)[slips], atol=1e-12)


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
        "import sys; import fingermodel.model; from fingermodel.fingers.files import read_finger; "
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
    document = document_of("synek2019_network")
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
    document = document_of("synek2019_network")
    network = yaml.safe_load((data_dir() / "hoods" / "hu2014b_index.yaml").read_text(encoding="utf-8"))
    block = network
    for key in place[:-1]:
        block = block[key]
    block[place[-1]] = value
    document["hood"]["network"] = network
    with pytest.raises(ModelError, match=said) as fault:
        finger_from_dict(document, "mine.yaml")
    assert "\n" not in str(fault.value)
