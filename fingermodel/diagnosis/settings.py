"""What the diagnosis assumes: priors with a meaning, thresholds of what is said, and tolerances of several modules.

`docs/explanations/diagnosis.md` says in words what each prior states. What one module alone needs stands at its top:
sizes of what it alone describes, how many nodes, fits or offers there are, and thresholds of tests without a model.
"""

from __future__ import annotations

import numpy as np

from fingermodel.diagnosis.axis import Axis

# --- Priors -----------------------------------------------------------------------------------------------------------
# Probability that no effect acts; the rest is shared by one, two and three effects.
P_NOTHING = 0.5
P_SIZES = (0.62, 0.32, 0.06)
# Probability of what is unusual: that an effect which acts is one marked `outside` the catalogue; that something smooth
# acts; and that this is of one tendon or of one rotation alone, not of all of them.
P_UNUSUAL = 0.1
# Multiple of the stated budget, and of the anatomy's priors: specimens differ by more than those of one study. Each is
# log-normal from 1 to 3; what wants more is not explained by what was stated, and something unknown acts. Below 1 one
# multiple of all errors would take the many that happen to be small for evidence that the few others are.
MULTIPLE = Axis.log_normal([1.0, 1.41, 2.0, 2.83], 1.0, np.exp(0.6))
# Error of an effect's form, relative: half-Cauchy. Up to FORM_NAMED the effect counts by its name.
FORM = Axis.half_cauchy(0.04, [0.0, 0.05, 0.1, 0.2, 0.4, 0.8])
FORM_NAMED = 0.1
# Something smooth [N]: an atom at none, else flat in its logarithm.
SMOOTH_N = Axis(np.array([0.0, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28]), np.zeros(9))
# Scatter from case to case: of each tendon's tension, relative; of each component of the reading, relative to it; of
# the force in every direction, relative to it; and of each joint angle [rad].
TENSION = Axis.size(0.7, 0.015, [0.0, 0.0025, 0.005, 0.0075, 0.01, 0.014, 0.02, 0.028, 0.04, 0.056])
READING = Axis.size(0.3, 0.01, [0.0, 0.005, 0.01, 0.02, 0.04])
ANGLE_RAD = Axis.size(0.3, 1.0, [0.0, 0.5, 1.0, 2.0]).times(np.deg2rad(1.0))
# Errors that a group of cases has in common. Those of one setting, for which the finger is clamped anew, are multiples
# of what the budget states of a whole session; those of one weight, and of one tendon's line, of a usual scatter.
OF_GROUP = Axis.size(0.3, 1.0, [0.0, 0.5, 1.0, 2.0, 3.0])
# Noise that plateau and tare do not show, of each reading by itself [N]: drift, what settles late. Where the noise is
# assumed, a multiple of it instead, log-normal about 1.
EXTRA_NOISE_N = Axis.size(0.5, 0.005, [0.0, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064])
ASSUMED_NOISE = Axis.log_normal([0.18, 0.25, 0.35, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83], 1.0, np.e)
# Power to which the evidence counts when explanations are weighed against each other. No model of a bench is complete,
# and what it lacks is alike in neighbouring readings: they say less than as many independent ones.
EVIDENCE_POWER = 0.7
# How often a case is bad.
P_BAD = 0.002
# That something acts which shows only in a validation case unlike any fitted one: by as much as in a bad case.
P_UNLIKE = 0.05
# What a bad case is: a slip of a kind, or anything. How far a load may then be off that is none of those in use,
# relative.
SLIP_SHARES = {
    "anything": 0.2,
    "tendon": 0.2,
    "mass": 0.2,
    "exchanged": 0.15,
    "amount": 0.1,
    "posture": 0.04,
    "mount": 0.02,
    "unloaded": 0.03,
    "kept": 0.03,
    "window": 0.03,
}
AMOUNT = 0.5
# The same of a weight wherever it hangs. Weights scatter; one that is hardly off is no mistake.
LEAST_AMOUNT = 0.05
# The same of one joint's angle in one posture: what is off by less was measured badly, not mistyped [rad].
WRONG_ANGLE_RAD, LEAST_ANGLE_RAD = np.deg2rad(20.0), np.deg2rad(8.0)
# A fault of the whole session: how often, and how far one mount's gain may then be from 1.
P_FAULT = 0.02
GAIN_SPREAD = 0.3
# A lever [mm] that turns an unexplained force into an unexplained moment.
LEVER_MM = 10.0

# --- What is said -----------------------------------------------------------------------------------------------------
SURE = 0.9
# Fewer identification cases decide nothing.
LEAST_CASES = 6
# Predictive check, and misfit of nothing missing: one chance in ten thousand is out of the question.
P_VALUE = 1e-4
# Canonical correlation from which two effects are one class.
ALIKE = 0.9
# An explanation less probable than this is not tested by a next load case, which is worth proposing from [nat]. Of two
# effects that sessions may share, what promises less is not fitted.
LIVE = 0.01
WORTH_NAT = 0.05

# Shuffles by which what sessions share is held against chance: enough for one chance in a hundred.
PERMUTATIONS = 199

# --- Numerical tolerances ---------------------------------------------------------------------------------------------
# Log posterior of an explanation below the leader's from which it is not fitted, and of a node of the hyperparameters
# below the best one's from which its neighbours are not summed.
WITHIN = 2.0
# The same from which its hyperparameters are not looked at further than where it leads upwards.
FAR = 30.0
# Of everything that is drawn.
SEED = 20191107
