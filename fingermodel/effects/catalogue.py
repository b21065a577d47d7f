"""Every effect of the catalogue, in the order in which they act within a stage."""

from __future__ import annotations

from fingermodel.effects.axis_tilt import AxisTilt
from fingermodel.effects.bowstringing import Bowstringing
from fingermodel.effects.cell_crosstalk import CellCrosstalk
from fingermodel.effects.cell_rotation import CellRotation
from fingermodel.effects.centre_migration import CentreMigration
from fingermodel.effects.clamp_compliance import ClampCompliance
from fingermodel.effects.fdp_fds_coupling import FdpFdsCoupling
from fingermodel.effects.goniometer_bias import GoniometerBias
from fingermodel.effects.hanger_mass import HangerMass
from fingermodel.effects.hood_shift import HoodShift
from fingermodel.effects.intrinsic_bowstring import IntrinsicBowstring
from fingermodel.effects.joint_friction import JointFriction
from fingermodel.effects.lateral_band_slip import LateralBandSlip
from fingermodel.effects.lumbrical_on_fdp import LumbricalOnFdp
from fingermodel.effects.rig_friction import RigFriction
from fingermodel.effects.segment_length import SegmentLength
from fingermodel.effects.sheath_friction import SheathFriction
from fingermodel.effects.suture_angle import SutureAngle
from fingermodel.effects.tare_drift import TareDrift
from fingermodel.effects.tip_location import TipLocation
from fingermodel.effects.volar_plate import VolarPlate
from fingermodel.effects.worn_pulley import WornPulley
from fingermodel.effects.zero_offset import ZeroOffset
from fingermodel.stages import Effect

CATALOGUE: tuple[Effect, ...] = (
    # Weights first, then what the pulleys pass of them.
    HangerMass(),
    RigFriction(),
    WornPulley(),
    # The hood shares anew, so it comes before what passes between the flexors.
    HoodShift(),
    LumbricalOnFdp(),
    FdpFdsCoupling(),
    SheathFriction(),
    GoniometerBias(),
    SegmentLength(),
    TipLocation(),
    CentreMigration(),
    AxisTilt(),
    LateralBandSlip(),
    IntrinsicBowstring(),
    Bowstringing(),
    # Under the load in the geometry as it is.
    ClampCompliance(),
    VolarPlate(),
    JointFriction(),
    SutureAngle(),
    # A turned cell reads turned forces; then its own errors.
    CellRotation(),
    CellCrosstalk(),
    ZeroOffset(),
    TareDrift(),
)
EFFECTS = {effect.name: effect for effect in CATALOGUE}


def remedy(candidate: str) -> str | None:
    """What measurement besides a load case would show an effect or one of its candidates; None where none is known."""
    effect = EFFECTS.get(candidate.partition(".")[0])
    return (effect.remedy(candidate) or None) if effect is not None else None
