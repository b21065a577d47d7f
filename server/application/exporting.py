"""Sessions and models written for other software, for whichever command or request was asked for it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from daq.export.excel import write_excel
from daq.export.formats import write_hdf5, write_mat
from daq.export.supplement import model_members, write_supplement
from daq.export.tables import case_columns, software, window_columns, write_columns, write_table
from daq.files import is_special
from fingermodel.comparing import compare
from fingermodel.diagnosis import settings
from fingermodel.fingers.files import finger_names, read_finger
from fingermodel.session import Session

if TYPE_CHECKING:
    from daq.measured import MeasuredSession
    from daq.sessions.models import Session as BenchSession
    from fingermodel.comparison.comparison import Comparison
    from fingermodel.model_files import Revision

# Endings that each format may have, the first one by default.
ENDINGS: Mapping[str, tuple[str, ...]] = {
    "csv": (".csv",),
    "parquet": (".parquet",),
    "xlsx": (".xlsx",),
    "hdf5": (".h5", ".hdf5"),
    "c3d": (".c3d",),
    "mat": (".mat",),
    "supplement": (".zip",),
}
OF_MODELS = ("csv", "parquet", "xlsx")


@contextmanager
def writing(path: Path, remedy: str = "Choose another --out") -> Iterator[None]:
    """Say in one line that a file cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror or error})",
            "a place that can be written to, with space left",
            remedy,
        ) from error


def write_table_file(
    columns: Mapping[str, list[Any]], path: Path, file_format: str, about: Mapping[str, Any]
) -> Path | None:
    """Write columns as `csv`, with what they are beside it, as `parquet` or as `xlsx`; return the file beside it.

    A pipe or a device has nothing beside it.
    """
    if file_format == "csv" and not is_special(path):
        return write_table(columns, path, about)
    if file_format == "xlsx":
        write_excel(columns, path, about)
        return None
    write_columns(columns, path, file_format)
    return None


def parameter_columns(revision: Revision) -> dict[str, list[Any]]:
    """Return a revision's parameters as columns, one row each."""
    rows = revision.document["parameters"]
    return {key: [row[key] for row in rows] for key in rows[0]} if rows else {}


def about_revision(revision: Revision, sources: Mapping[str, str]) -> dict[str, Any]:
    """Return the origin of a table of parameters; `sources` are SHA-256 by name."""
    return {
        "software": software(),
        "session": revision.session,
        "model": revision.id,
        "sources": dict(sources),
    }


def bench_columns(bench: Session, hidden: Collection[str] = ()) -> dict[str, list[Any]]:
    """Return measured and predicted cases as columns, one row a case.

    Args:
        bench: session and model.
        hidden: cases whose predictions are left empty.
    """
    columns = {**case_columns(bench.measured), **_predicted_columns(compare(bench), hidden)}
    return columns | {"model": [bench.loaded.name] * len(columns["id"])}


def about_bench(bench: Session, sources: Mapping[str, Any], hidden: Collection[str] = ()) -> dict[str, Any]:
    """Return the origin of a table of cases; `sources` are fingerprints by name."""
    measured = bench.measured
    notes = list(measured.notes)
    if hidden:
        notes.append(f"{len(hidden)} validation cases without prediction, which is hidden until the session is closed")
    return {
        "software": software(),
        "session": measured.session.id,
        "model": bench.loaded.name,
        "tension_factor_source": measured.tension_factor_source,
        "sources": dict(sources),
        "notes": notes,
    }


def write_whole(
    bench: Session,
    session: BenchSession,
    path: Path,
    file_format: str,
    about: Mapping[str, Any],
    hidden: Collection[str] = (),
) -> int:
    """Write cases and readings as `hdf5` or `mat`; return the number of cases.

    Args:
        bench: session and model.
        session: in its folder, with its readings.
        path: of the file.
        file_format: hdf5 or mat.
        about: of `about_bench`.
        hidden: cases whose predictions are left empty.
    """
    columns = {**bench_columns(bench, hidden), **window_columns(bench.measured)}
    (write_hdf5 if file_format == "hdf5" else write_mat)(session, columns, path, about)
    return len(columns["id"])


def write_paper(
    measured: MeasuredSession,
    bench: Session | None,
    models: Sequence[Mapping[str, Any]],
    path: Path,
    sources: Mapping[str, Any],
    hidden: Collection[str] = (),
) -> tuple[int, dict[str, int]]:
    """Write the supplement of a paper.

    Args:
        measured: the session, in its folder.
        bench: of it and the model whose predictions go along; None for none.
        models: documents of that model and of the revisions before it.
        path: of the archive.
        sources: fingerprints of what the session was read from, by name.
        hidden: cases whose predictions are left empty.

    Returns:
        the number of cases, and how many private things were replaced, by kind.
    """
    about: dict[str, Any] = {"software": software(), "sources": dict(sources)}
    if bench is None:
        columns: Mapping[str, list[Any]] = {**case_columns(measured)}
    else:
        columns = bench_columns(bench, hidden)
        about["model"] = bench.loaded.name
    replaced = write_supplement(
        measured,
        columns,
        path,
        about=about,
        models=models,
        finger=own_finger(measured.session),
        commands=_commands(models),
    )
    return len(columns["id"]), replaced


def own_finger(session: BenchSession) -> dict[str, Any] | None:
    """Return the document of the session's finger, where it does not come with the software."""
    if session.finger in finger_names() and not (session.folder and (session.folder / session.finger).is_file()):
        return None
    return read_finger(session.finger, session.folder).document


def _commands(models: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return seeds, and what makes every figure and revision again, run beside the supplement's session.yaml."""
    from fingermodel.fitting.identification import SEED

    members = model_members(models)
    chosen = f" --model {members[0]}" if members else ""
    revisions = []
    for i, (member, document) in enumerate(zip(members, models, strict=True)):
        if not member.endswith(".json"):
            continue
        start = members[i + 1] if i + 1 < len(members) else document["parent"]
        given = f"session.yaml --model {start} --out again-{i}.json"
        changed = " ".join([*document["added"], *(f"--without {name}" for name in document["removed"])])
        command = f"add {changed} {given}" if changed else f"refit {given} --method {document['method']}"
        revisions.append({"file": member, "id": document["id"], "command": f"fingertwin {command}"})
    pages = {name: f"fingertwin {name} session.yaml{chosen} --figures figures" for name in ("compare", "diagnose")}
    return {
        "seeds": {
            "refit": SEED,
            "next": settings.SEED,
        },
        "figures": [{"file": f"figures/{n}.html, and PNG and SVG beside it", "command": c} for n, c in pages.items()],
        "revisions": revisions,
    }


def _predicted_columns(comparison: Comparison, hidden: Collection[str]) -> dict[str, list[Any]]:
    """Return predicted force and tip moment, force residual and z of every case, in the measured cases' order."""
    columns: dict[str, list[Any]] = {}
    shown = [None if c.id in hidden else c for c in comparison.cases]
    for i, axis in enumerate("xyz"):
        predicted = [None if c is None else float(c.predicted_N[i]) for c in shown]
        measured = [float(c.measured_N[i]) for c in comparison.cases]
        columns[f"predicted_F{axis}_N"] = predicted
        columns[f"residual_F{axis}_N"] = [
            None if p is None else m - p for m, p in zip(measured, predicted, strict=True)
        ]
        columns[f"predicted_T{axis}_Nmm"] = [
            None if c is None or c.predicted_Nmm is None else float(c.predicted_Nmm[i]) for c in shown
        ]
    return columns | {"z": [None if c is None else c.z for c in shown]}
