"""`fingertwin export` and `fingertwin simulate`."""

from __future__ import annotations

import json as json_module
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from server.console import answer, progress, say
from server.workflow import Bench, compare_bench, open_bench

if TYPE_CHECKING:
    from daq.session_models import Session
    from fingermodel.compare import Comparison


# Endings that each format may have, the first one by default.
ENDINGS: Mapping[str, tuple[str, ...]] = {
    "csv": (".csv",),
    "parquet": (".parquet",),
    "hdf5": (".h5", ".hdf5"),
    "c3d": (".c3d",),
    "mat": (".mat",),
    "supplement": (".zip",),
}
OF_MODELS = ("csv", "parquet")


def export_source(source: str, file_format: str, out: Path | None, model: str | None, json: str | None) -> None:
    """Write a session's cases, measured and predicted, its readings, or a revision's parameters in a file format."""
    ending = "" if out is None else out.suffix.lower()
    if ending in {e for known in ENDINGS.values() for e in known} - set(ENDINGS[file_format]):
        raise InputError(
            f"--format {file_format} and {out.name if out else ''}", "one of the two", "Let name and format agree"
        )
    body: dict[str, Any] = {"source": source}
    if Path(source).suffix == ".json" and Path(source).is_file():
        body |= _export_revision(Path(source), file_format, out, model)
    elif file_format == "c3d":
        body |= _export_channels(source, out, model)
    elif file_format == "supplement":
        body |= _export_supplement(source, out, model)
    else:
        body |= _export_session(source, file_format, out, model)
    if answer("export", body, json):
        return
    rows = f"{body['rows']} rows: " if body["rows"] is not None else ""
    say(f"{rows}{body['file']}")
    if file_format == "supplement":
        kinds = ", ".join(f"{n} {kind}" for kind, n in body["replaced"].items()) or "nothing"
        say(f"Replaced: {kinds}. Names that nothing marks as such stay: read its notes before you publish it.")


def _path(out: Path | None, name: str, file_format: str) -> Path:
    stem = Path(name).name or "export"
    return out or Path(f"{stem}{'-supplement' if file_format == 'supplement' else ''}{ENDINGS[file_format][0]}")


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Say in one line that a file cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror or error})",
            "a place that can be written to, with space left",
            "Choose another --out",
        ) from error


def _write(columns: Mapping[str, list[Any]], path: Path, file_format: str, about: Mapping[str, Any]) -> dict[str, Any]:
    from daq.export import write_columns, write_table

    body: dict[str, Any] = {"file": str(path), "rows": len(next(iter(columns.values()), []))}
    with _writing(path):
        if file_format == "csv":
            return body | {"sidecar": str(write_table(columns, path, about))}
        write_columns(columns, path, file_format)
    return body


def _export_revision(source: Path, file_format: str, out: Path | None, model: str | None) -> dict[str, Any]:
    from daq.export import sha256_of, software
    from fingermodel.model_files import read_revision

    if model is not None:
        raise InputError(f"--model {model} with a model to export", "no --model", "Leave it out")
    if file_format not in OF_MODELS:
        raise InputError(f"--format {file_format} with a model", f"one of {' '.join(OF_MODELS)}", "Or give a session")
    revision = read_revision(source)
    rows = revision.document["parameters"]
    columns = {key: [row[key] for row in rows] for key in rows[0]} if rows else {}
    about = {
        "software": software(),
        "session": revision.session,
        "model": revision.id,
        "sources": {source.name: sha256_of(source)},
    }
    return _write(columns, _path(out, revision.id, file_format), file_format, about)


def _export_session(source: str, file_format: str, out: Path | None, model: str | None) -> dict[str, Any]:
    from daq.export import case_columns, software, sources_of, window_columns
    from daq.export_formats import write_hdf5, write_mat
    from daq.sessions import find_session

    with progress("Reading and correcting") as tell:
        bench = open_bench(source, model, tell)
    measured = bench.measured
    session = measured.session
    columns = {**case_columns(measured), **_predicted_columns(compare_bench(bench))}
    columns["model"] = [bench.loaded.name] * len(columns["id"])
    path = _path(out, session.id, file_format)
    about = {
        "software": software(),
        "session": session.id,
        "model": bench.loaded.name,
        "tension_factor_source": measured.tension_factor_source,
        "sources": sources_of(session, find_session(source)),
        "notes": list(measured.notes),
    }
    if file_format in ("csv", "parquet"):
        return _write(columns, path, file_format, about)
    columns |= window_columns(measured)
    with _writing(path):
        (write_hdf5 if file_format == "hdf5" else write_mat)(session, columns, path, about)
    return {"file": str(path), "rows": len(columns["id"])}


def _export_channels(source: str, out: Path | None, model: str | None) -> dict[str, Any]:
    from daq.export_formats import write_c3d
    from daq.sessions import read_session

    if model is not None:
        raise InputError(f"--model {model} with --format c3d", "no --model: it holds readings alone", "Leave it out")
    session = read_session(source)
    path = _path(out, session.id, "c3d")
    with progress("Reading"), _writing(path):
        write_c3d(session, path)
    return {"file": str(path), "rows": None}


def _export_supplement(source: str, out: Path | None, model: str | None) -> dict[str, Any]:
    from daq.corrections import measure
    from daq.export import case_columns, software
    from daq.sessions import find_session, read_session
    from daq.supplement import write_supplement

    about = {"software": software()}
    models: list[dict[str, Any]] = []
    with progress("Reading and correcting") as tell:
        if model is None:
            measured = measure(read_session(source), tell)
            columns = {**case_columns(measured)}
        else:
            bench = open_bench(source, model, tell)
            measured = bench.measured
            columns = {**case_columns(measured), **_predicted_columns(compare_bench(bench))}
            columns["model"] = [bench.loaded.name] * len(columns["id"])
            about["model"] = bench.loaded.name
            models = _revisions(model, bench)
    session = measured.session
    path = _path(out, session.id, "supplement")
    finger, commands = _own_finger(session), _commands(models)
    with _writing(path):
        replaced = write_supplement(
            measured,
            columns,
            path,
            about=about,
            session_file=find_session(source),
            models=models,
            finger=finger,
            commands=commands,
        )
    return {"file": str(path), "rows": len(columns["id"]), "replaced": replaced}


def _revisions(model: str, bench: Bench) -> list[dict[str, Any]]:
    """The document of the model, and of the revisions before it that lie beside it."""
    from fingermodel.model_files import read_revision

    path = Path(model)
    if path.suffix != ".json":
        return [bench.model.finger.document]
    found = [read_revision(path).document]
    beside = {}
    for file in sorted(path.parent.glob("*.json")):
        with suppress(InputError, OSError):  # other files may lie there too
            document = read_revision(file).document
            beside[document["id"]] = document
    while (before := beside.pop(found[-1]["parent"], None)) is not None:
        found.append(before)
    return found


def _own_finger(session: Session) -> dict[str, Any] | None:
    """The document of the session's finger, where it does not come with the software."""
    from fingermodel.finger_files import finger_names, read_finger

    if session.finger in finger_names() and not (session.folder and (session.folder / session.finger).is_file()):
        return None
    return read_finger(session.finger, session.folder).document


def _commands(models: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Seeds, and what makes every figure and revision again, run beside the supplement's session.yaml."""
    from daq.supplement import model_members
    from fingermodel.diagnosis import calibration, held_out, next_cases
    from fingermodel.refit import SEED

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
            "diagnose: calibration": calibration.SEED,
            "diagnose: held-out cases": held_out.SEED,
            "next": next_cases.SEED,
        },
        "figures": [{"file": f"figures/{n}.html, and PNG and SVG beside it", "command": c} for n, c in pages.items()],
        "revisions": revisions,
    }


def _predicted_columns(comparison: Comparison) -> dict[str, list[Any]]:
    """Predicted force and tip moment, force residual and z of every case, in the measured cases' order."""
    columns: dict[str, list[Any]] = {}
    for i, axis in enumerate("xyz"):
        columns[f"predicted_F{axis}_N"] = [float(c.predicted_N[i]) for c in comparison.cases]
        columns[f"residual_F{axis}_N"] = [float(c.measured_N[i] - c.predicted_N[i]) for c in comparison.cases]
        columns[f"predicted_T{axis}_Nmm"] = [
            None if c.predicted_Nmm is None else float(c.predicted_Nmm[i]) for c in comparison.cases
        ]
    return columns | {"z": [c.z for c in comparison.cases]}


def simulate_rig(
    protocol: str, out: Path, model: str, rate_hz: float, noise_N: float, repeats: int, seed: int, json: str | None
) -> None:
    """Write a simulated session, with the truth beside it."""
    from daq.protocols import read_protocol
    from daq.simulated import SimulatedCell
    from fingermodel.finger_files import read_finger
    from fingermodel.model_files import read_revision
    from fingermodel.rig import simulate_session

    if not 0 < rate_hz <= 1e6 or not 0 <= noise_N <= 1e3 or repeats < 1 or seed < 0:
        raise InputError(
            f"rate {rate_hz:g} Hz, noise {noise_N:g} N, {repeats} repeats, seed {seed}",
            "a rate above 0 and up to 1e6, noise of 0 to 1000, 1 repeat or more, a seed of 0 or more",
        )
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"{out} is not empty", "a new folder", "Choose another --out")
    finger = read_revision(Path(model)).finger if Path(model).suffix == ".json" else read_finger(model)
    cell = SimulatedCell(rate_hz=rate_hz, noise_sd=(noise_N,) * 3 + (noise_N * 7.0,) * 3)
    with progress("Simulating"):
        session, truth = simulate_session(
            finger, read_protocol(protocol), out, cell=cell, seed=seed, session_id=out.resolve().name, repeats=repeats,
            finger_name=None if Path(model).suffix != ".json" else finger.document["id"],
        )  # fmt: skip
    wrenches = {name: [round(float(x), 6) for x in wrench] for name, wrench in truth.items()}
    (out / "truth.json").write_text(json_module.dumps({"id": session.id, "wrench_N_Nmm": wrenches}, indent=1) + "\n")
    body = {"session": str(out), "cases": len(session.cases), "rate_hz": rate_hz, "seed": seed}
    if not answer("simulate", body, json):
        say(f"{len(session.cases)} load cases at {rate_hz:g} Hz: {out}   (fingertwin compare {out})")
