"""An effect of a user's in a Python file, for tests that need one."""

from __future__ import annotations

from pathlib import Path

CODE = '''
from __future__ import annotations
from dataclasses import dataclass
import jax.numpy as jnp
from fingermodel.effects.places import flexion_of
from fingermodel.rows import spread
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect

@dataclass(frozen=True)
class Mine(Effect):
    """PIP torque with the extensor's tension."""

    name = "mine"
    stage = "torque"
    title = "a stiff joint"
    formula = "tau_PIP += k T_EDC sin q_PIP"
    source = "ours"

    def parameters(self, topology, layout):
        return (two_sided("mine.k", "mm", 5.0),)

    def torque(self, p, case, state):
        pip, edc = flexion_of(state.topology, "PIP"), state.topology.muscles.index("EDC")
        added = p[0] * state.tension[edc] * jnp.sin(state.posture[pip])
        return state._replace(torque=state.torque + added * spread([pip], len(state.topology.rotations))[0])
'''


def python_file(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write it, with changes to its text."""
    path, text = folder / "mine.py", CODE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path
