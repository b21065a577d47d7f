"""Read and write bench sessions: a folder with `session.yaml` and, for raw readings, the file that it names."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from daq.documents import EACH_ONCE, RepeatedKeyError, load_yaml, yaml_fault
from daq.errors import SessionError
from daq.files import replacing
from daq.locations import data_dir
from daq.sessions.faults import line_of, lines_of, summary
from daq.sessions.models import FORMAT, Session
from daq.sessions.rules import faults_between
from daq.vocabulary import did_you_mean

try:  # libyaml is ten times faster, and not built everywhere
    from yaml import CSafeDumper as SafeDumper
except ImportError:
    from yaml import SafeDumper  # type: ignore[assignment]

SESSION_FILE = "session.yaml"
# Of a bench, beside it.
JOURNAL_FILE = "journal.sqlite3"
AMENDMENTS_FILE, AMENDMENTS_FORMAT = "amendments.yaml", "bench-amendments/1"
# Of a document that brings its own finger instead of naming a file.
FINGER_DOCUMENT = "finger_document"


def session_names() -> list[str]:
    """Return the names of the sessions that come with the software."""
    folder = data_dir() / "sessions"
    return sorted(p.parent.name for p in folder.glob(f"*/{SESSION_FILE}"))


def find_session(path: str | Path) -> Path:
    """Return the session.yaml that a folder, a file or the bare name of a shipped session stands for.

    Raises:
        SessionError: there is none.
    """
    given = Path(path)
    if given.is_file():
        if given.suffix.lower() not in (".yaml", ".yml"):
            raise SessionError(
                f"{given.name} is no session's description",
                f"a session's folder, or its {SESSION_FILE}",
                f"Readings need a {SESSION_FILE} beside them: docs/how-to/prepare-a-session.md",
            )
        return given
    if given.is_dir():
        file = given / SESSION_FILE
        if file.is_file():
            return file
        # Until a bench has ended, its session is in its journal alone.
        journal = f"Where a bench broke off, {JOURNAL_FILE} holds its session: the same command with --resume goes on"
        remedy = journal if (given / JOURNAL_FILE).is_file() else ""
        raise SessionError(f"folder {given} has no {SESSION_FILE}", "a bench session's folder", remedy)
    shipped = data_dir() / "sessions" / given.name / SESSION_FILE
    if len(given.parts) == 1 and shipped.is_file():
        return shipped
    hint = did_you_mean(str(path), session_names())
    raise SessionError(
        f"no session at {path}",
        f"a session's folder, its {SESSION_FILE}, or a shipped one by name",
        hint or "Shipped sessions lie in data/sessions",
    )


def require_once(sessions: Sequence[str]) -> None:
    """Refuse a session that is given twice, also where it is named once by its folder: its cases would count twice.

    Raises:
        SessionError: one is, or there is none of a name.
    """
    files = set()
    for session in sessions:
        file = find_session(session).resolve()
        if file in files:
            raise SessionError(f"session {session} is given twice", "each session once")
        files.add(file)


def read_session(path: str | Path) -> Session:
    """Read a bench session.

    Args:
        path: its folder, its `session.yaml`, or the name of a shipped session.

    Raises:
        SessionError: it is absent or cannot be used; the line names the place in the file and how many faults follow.
    """
    file = find_session(path)
    session, faults = parse_session(session_data(file), file.parent, _short(file))
    if session is None:
        raise summary(faults)
    return session


def session_data(file: Path) -> Any:
    """Return plain data of a `session.yaml` and of the amendments beside it."""
    data = read_yaml(file)
    beside = read_amendments(file.parent)
    if beside and isinstance(data, Mapping):
        before = data.get("amendments")
        return {**data, "amendments": [*(before if isinstance(before, list) else []), *beside]}
    return data


def read_amendments(folder: Path) -> list[dict[str, Any]]:
    """Return plain data of the amendments in a session's folder; none where there is no such file.

    Raises:
        SessionError: the file cannot be used.
    """
    file = folder / AMENDMENTS_FILE
    if not file.is_file():
        return []
    document, remedy = read_yaml(file), "Write it with fingertwin amend"
    if not isinstance(document, Mapping) or document.get("format") != AMENDMENTS_FORMAT:
        raise SessionError(f"{AMENDMENTS_FILE} has another format", f"format: {AMENDMENTS_FORMAT}", remedy)
    listed = document.get("amendments")
    if not isinstance(listed, list) or not all(isinstance(a, Mapping) for a in listed):
        raise SessionError(f"{AMENDMENTS_FILE} has no list of amendments", "amendments: a list", remedy)
    return [dict(a) for a in listed]


def parse_session(data: object, folder: Path | None, file: str = "") -> tuple[Session | None, list[SessionError]]:
    """Make a session from plain data, or list everything that is wrong with it.

    Args:
        data: what the YAML file holds.
        folder: where the readings lie; their absence is a fault. None skips that check.
        file: name of the file, for messages.

    Returns:
        the session, or None with the faults in the order of the file.
    """
    if not isinstance(data, Mapping):
        found = "is empty" if data is None else "has no keys with values"
        return None, [
            SessionError(f"{file or 'the session'} {found}", f"keys with values, the first one `format: {FORMAT}`")
        ]
    between = [line_of(f, data, file) for f in faults_between(data)]
    try:
        session = Session.model_validate(data)
    except ValidationError as error:
        faults = lines_of(error, data, file) + between
        if not faults:
            faults = [SessionError(f"{file or 'the session'}: {error.errors()[0]['msg']}")]
        return None, faults
    session = session.in_folder(folder)
    path = session.readings_path
    if path is not None and not path.is_file():
        found = f"{file}: readings names {session.readings!r}, which is not in {folder}"
        return None, [SessionError(found, "a file in the session's folder", "Copy it there, or correct the name")]
    return session, []


def faults_of(path: str | Path) -> list[SessionError]:
    """List every fault in a session's description."""
    try:
        file = find_session(path)
        return parse_session(session_data(file), file.parent, _short(file))[1]
    except SessionError as error:
        return [error]


def plain_document(session: Session) -> dict[str, Any]:
    """Return a session as it was entered, as plain data; defaults that a reader would have to know are written out."""
    session = session.entered
    data = session.model_dump(mode="json", exclude_defaults=True)
    data["gravity_m_s2"] = session.gravity_m_s2
    data["postures_deg"] = {name: posture.model_dump() for name, posture in session.postures_deg.items()}
    return data


def whole_document(session: Session, name: str | None = None) -> dict[str, Any]:
    """Return a session as plain data that stands without its folder: with its finger, where that is a file.

    Args:
        session: as read.
        name: that it is to have, if another than its own.
    """
    out = plain_document(session)
    if name is not None:
        out["id"] = name
    finger = own_finger(session.finger, session.folder)
    return out if finger is None else out | {FINGER_DOCUMENT: finger}


def own_finger(name: str, folder: Path | None = None) -> Any:
    """Return the document of a finger that is a file, in a folder or from here; None for one that has a name alone.

    Args:
        name: as a session or a setup gives it.
        folder: of the session.
    """
    file = finger_file(name, folder)
    return None if file is None else read_yaml(file)


def finger_file(name: str, folder: Path | None = None) -> Path | None:
    """Return the file of a finger, in a folder or from here; None of one that has a name alone."""
    return next((file for file in ((folder or Path()) / name, Path(name)) if file.is_file()), None)


def write_session(session: Session, folder: str | Path) -> Path:
    """Write a session's description, and its readings where they lie in another folder.

    Returns:
        the path of its `session.yaml`, which was renamed into place when complete.
    """
    target = Path(folder)
    source = session.readings_path
    if source is not None and session.readings is not None:
        copy = target / session.readings
        if source.is_file() and copy.resolve() != source.resolve():
            with replacing(copy) as temporary:
                shutil.copyfile(source, temporary)
    with replacing(target / SESSION_FILE) as temporary:
        temporary.write_text(session_text(session), encoding="utf-8")
    return target / SESSION_FILE


def session_text(session: Session) -> str:
    """Return a session's description as the text of its `session.yaml`."""
    data = plain_document(session)
    cases: list[Any] = data.get("cases", [])
    data["cases"] = []
    text = _text({key: data[key] for key in (*Session.model_fields, *(session.model_extra or {})) if key in data})
    # Thousands of cases at once would be as many nodes in memory, which Python looks through again and again.
    blocks = "".join(_text(cases[i : i + 200]) for i in range(0, len(cases), 200))
    return text.replace("\ncases: []\n", f"\ncases:\n{blocks}", 1) if cases else text


def _text(value: Any) -> str:
    out: str = yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
    return out


def read_yaml(file: Path, name: str | None = None) -> Any:
    """Read a YAML file, refusing a key given twice.

    Args:
        file: its path.
        name: of it in messages; by default with its folder's.

    Raises:
        SessionError: it cannot be read, with the line of the fault.
    """
    name = name or _short(file)
    try:
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise SessionError(
            f"{name} is not UTF-8 text (byte {error.start})", "a text file", "Save it as UTF-8"
        ) from error
    except OSError as error:
        raise SessionError(f"{name} cannot be read ({error.strerror})", "a readable file") from error
    try:
        return load_yaml(text)
    except RepeatedKeyError as error:
        raise SessionError(f"{name}{yaml_fault(error)}", *EACH_ONCE) from error
    except yaml.YAMLError as error:
        raise SessionError(f"{name} is not YAML{yaml_fault(error)}", "YAML") from error
    except (TypeError, ValueError) as error:  # a list as a key, the 45th of a month
        raise SessionError(
            f"{name} holds what YAML allows and nobody can read ({error})", "plain keys and values"
        ) from error


def _short(file: Path) -> str:
    return f"{file.parent.name}/{file.name}" if file.parent.name else file.name


class _Dumper(SafeDumper):
    """YAML with short lists and masses on one line."""


def _represent_list(dumper: _Dumper, data: list[Any]) -> yaml.Node:
    plain = all(isinstance(v, int | float | list) or (isinstance(v, str) and len(v) < 30) for v in data)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=plain)


def _represent_dict(dumper: _Dumper, data: dict[str, Any]) -> yaml.Node:
    flow = bool(data) and len(data) < 7 and all(isinstance(v, int | float) for v in data.values())
    return dumper.represent_mapping("tag:yaml.org,2002:map", data.items(), flow_style=flow or not data)


_Dumper.add_representer(list, _represent_list)
_Dumper.add_representer(dict, _represent_dict)
