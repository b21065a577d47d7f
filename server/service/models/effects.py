"""Effects that the service knows: the catalogue, and those that users gave as formulas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sqlalchemy import insert, select

from daq.errors import ModelError
from fingermodel.effects import catalogue
from fingermodel.effects.catalogue import EFFECTS
from fingermodel.effects.user import effect_document, effect_from_dict, load_effect, shipped_effects
from fingermodel.stages import Effect
from server.application.catalogue import effect_row
from server.service.storage.audit import record
from server.service.storage.database import Database, now_utc
from server.service.storage.schema import own_effects
from server.service.web.problems import ProblemError, not_found, shortened

_MOST_EFFECTS = 500


class OwnEffects:
    """Keeps users' effects: formulas on a whitelist, never code.

    Args:
        database: where they are kept.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, document: Mapping[str, Any]) -> tuple[dict[str, Any], bool]:
        """Keep an effect; a name once taken keeps its meaning.

        Args:
            document: a fingertwin-effect/1, or only a `formula` such as `torque[PIP] += k * t_EDC * sin(q_PIP)`.

        Returns:
            the effect as shown, and whether it is new.

        Raises:
            ModelError: the formula, its units or its parameters cannot be used.
            ProblemError: 409 another effect has the name.
        """
        effect = made(document)
        # Before it is kept: what cannot be shown is refused.
        kept, shown = effect_document(effect), self._shown(effect)
        with self._database.writing() as connection:
            rows = connection.execute(select(own_effects)).all()
            for row in rows:
                if row.name == effect.name:
                    if row.document == kept:
                        return shown, False
                    raise ProblemError(
                        409,
                        f"effect {effect.name} is there, and differs",
                        "another name",
                        "Rename the effect; what models hold of it stays as it is",
                    )
            if len(rows) >= _MOST_EFFECTS:
                raise ProblemError(409, f"{len(rows)} effects", f"at most {_MOST_EFFECTS}", "Use one that is there")
            values = {"name": effect.name, "created_utc": now_utc(), "document": kept}
            connection.execute(insert(own_effects).values(values))
            record(connection, "effect kept", None, {"name": values["name"], "document": values["document"]})
        return shown, True

    def check(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """Return what an effect would be, without keeping it.

        Raises:
            ModelError: it cannot be used.
        """
        return self._shown(made(document))

    def shown(self) -> list[dict[str, Any]]:
        """Return every effect, the catalogue first; what an earlier version kept and cannot be shown is left out."""
        out = [effect_row(e) | {"own": False} for e in catalogue.CATALOGUE]
        for effect in self.all():
            with suppress(ModelError):
                out.append(self._shown(effect))
        return out

    def one(self, name: str) -> dict[str, Any]:
        """Return an effect.

        Raises:
            ProblemError: 404 there is none.
        """
        if name in EFFECTS:
            return effect_row(EFFECTS[name]) | {"own": False}
        for effect in self.named([name] if "." not in name else []):
            return self._shown(effect)
        if name in shipped_effects():
            return effect_row(load_effect(Path(name))) | {"own": False}
        raise not_found("effect", name, "/api/v1/effects")

    def named(self, names: Sequence[str]) -> tuple[Effect, ...]:
        """Return users' effects by name; names of the catalogue and of what comes beyond it are passed over.

        Raises:
            ProblemError: 404 there is none.
        """
        out, beyond = [], shipped_effects()
        with self._database.reading() as connection:
            for name in dict.fromkeys(n.split(".")[0] for n in names):
                if name in EFFECTS:
                    continue
                query = select(own_effects.c.document).where(own_effects.c.name == name)
                document = connection.execute(query).scalar()
                if document is None and name in beyond:
                    continue
                if document is None:
                    raise not_found("effect", name, "/api/v1/effects")
                out.append(effect_from_dict(document, name))
        return tuple(out)

    def all(self) -> tuple[Effect, ...]:
        """Return every user's effect."""
        rows = self._database.rows(select(own_effects).order_by(own_effects.c.name))
        return tuple(effect_from_dict(r.document, r.name) for r in rows)

    @staticmethod
    def _shown(effect: Effect) -> dict[str, Any]:
        return effect_row(effect) | {"own": True, "document": effect_document(effect)}


def made(document: Mapping[str, Any]) -> Effect:
    """Make an effect of a document or of a bare formula.

    Raises:
        ModelError: it cannot be used.
        ProblemError: 422 it is Python code, which is not taken over the network.
    """
    from server.application.additions import formula_of

    if set(document) == {"formula"}:
        text = document["formula"]
        if text is None:
            raise ProblemError(422, "neither a formula nor a document", "one of the two", "Send formula or effect")
        if not isinstance(text, str) or len(text) > 2000:
            raise ProblemError(
                422,
                f"formula {shortened(text)!r}",
                "a text such as torque[PIP] += k * t_EDC",
                "Write a stage, its joint or tendon, and what is added there",
            )
        effect: Effect = formula_of(text)
        return effect
    if document.get("format") != "fingertwin-effect/1":
        raise ProblemError(
            422,
            f"an effect of format {shortened(document.get('format'))!r}",
            "fingertwin-effect/1, or {formula}",
            "Set format to fingertwin-effect/1",
        )
    return effect_from_dict(dict(document), "the effect")
