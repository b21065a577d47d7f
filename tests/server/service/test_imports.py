"""Folders that are sent as they are: taken in whole with their readings, or refused in one line with nothing kept."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daq.sessions import find_session
from server.workflow import compare_bench, open_bench
from tests.server.service.running import ServiceReceiver

RECORDED, PUBLISHED = "DEV-02", "synek2019_H01"
AT = "/api/v1/imports"
Files = dict[str, bytes]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path_factory.mktemp("service"))
    yield out
    out.close()


def folder_of(name: str) -> Files:
    """The files of a shipped session."""
    return {p.name: p.read_bytes() for p in find_session(name).parent.iterdir() if p.is_file()}


def send(service: ServiceReceiver, files: Files, **more: Any) -> Any:
    rows = [{"name": n, "base64": base64.b64encode(content).decode()} for n, content in files.items()]
    return service.client().post(AT, json={"files": rows} | more)


def readings(files: Files) -> list[str]:
    return gzip.decompress(files["readings.csv.gz"]).decode().splitlines()


def with_readings(lines: list[str]) -> Files:
    return folder_of(RECORDED) | {"readings.csv.gz": gzip.compress("\n".join(lines).encode() + b"\n")}


def test_a_folder_is_compared_as_by_the_command_line(service: ServiceReceiver) -> None:
    made = send(service, folder_of(RECORDED))
    assert made.status_code == 201, made.text
    assert made.json()["cases"] == {"measured": 96}
    ours = service.client().get(f"/api/v1/sessions/{RECORDED}/comparison").json()["cases"]
    theirs = compare_bench(open_bench(RECORDED)).as_dict()["cases"]
    assert [c["residual_N"] for c in ours] == [pytest.approx(c["residual_N"]) for c in theirs]
    again = send(service, folder_of(RECORDED))
    assert (again.status_code, again.json()["version"]) == (200, made.json()["version"])


def test_a_folder_without_readings_and_one_under_another_name(service: ServiceReceiver) -> None:
    assert send(service, folder_of(PUBLISHED), id="H01-again").json()["id"] == "H01-again"
    assert send(service, folder_of(RECORDED), id="other").json()["cases"] == {"measured": 96}


def test_readings_need_not_be_packed_nor_named_so(service: ServiceReceiver) -> None:
    files = folder_of(RECORDED)
    plain = files | {"readings.csv.gz": gzip.decompress(files["readings.csv.gz"])}
    assert send(service, plain, id="plain").json()["cases"] == {"measured": 96}


def changed(find: str, instead: str) -> Files:
    files = folder_of(RECORDED)
    text = files["session.yaml"].decode()
    assert find in text
    return files | {"session.yaml": text.replace(find, instead, 1).encode()}


def bad() -> dict[str, tuple[Files, str]]:
    files = folder_of(RECORDED)
    lines = readings(files)
    head, first = lines[0], lines[1].split(",")
    description = files["session.yaml"]
    return {
        "no session": ({"notes.txt": b"x"}, "none of them session.yaml"),
        "no readings": ({"session.yaml": description}, "which is not among the files"),
        "a column lacks": (with_readings([",".join(row.split(",")[:-1]) for row in lines]), "Tz_Nmm"),
        "not a number": (with_readings([head, ",".join([*first[:3], "nan", *first[4:]]), *lines[2:]]), "is 'nan'"),
        "wrong units": (with_readings([head.replace("Fx_N", "Fx_furlong"), *lines[1:]]), "Fx_furlong"),
        "no rows": (with_readings([head]), "a header and no readings"),
        "torn": (files | {"readings.csv.gz": files["readings.csv.gz"][:5000]}, "torn or damaged"),
        "not YAML": (files | {"session.yaml": b"format: [bench-session/1"}, "not YAML"),
        "not a session": (files | {"session.yaml": b"- one\n- two\n"}, "keys with values"),
        "another format": (changed("bench-session/1", "bench-session/7"), "bench-session/1"),
        "a file elsewhere": (changed("readings.csv.gz", "../../../etc/passwd"), "which is not among the files"),
        "a finger elsewhere": (changed("an1979_middle", "/etc/passwd"), "finger names '/etc/passwd'"),
        "a path": (files | {"../x.csv": b"1"}, "a file called '../x.csv'"),
        "a bomb": (
            files | {"session.yaml": b"a0: &a0 [1,1,1,1,1,1,1,1,1]\n" + b"".join(
                b"a%d: &a%d [%s]\n" % (k, k, b",".join([b"*a%d" % (k - 1)] * 9)) for k in range(1, 12))},
            "more than",
        ),
        "itself": (files | {"session.yaml": b"a: &a {b: *a}\n"}, "levels"),
    }  # fmt: skip


@pytest.mark.parametrize("what", list(bad()))
def test_a_folder_that_cannot_be_used_is_refused_in_one_line(service: ServiceReceiver, what: str) -> None:
    files, said = bad()[what]
    name = "bad-" + what.replace(" ", "-")
    answer = send(service, files, id=name)
    assert answer.status_code == 422, answer.text
    assert said in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]
    assert service.client().get(f"/api/v1/sessions/{name}").status_code == 404


def test_what_is_no_base64_or_too_large_is_refused(service: ServiceReceiver, tmp_path: Path) -> None:
    body = {"files": [{"name": "session.yaml", "base64": "*"}]}
    assert "base64" in service.client().post(AT, json=body).json()["detail"]
    small = ServiceReceiver(tmp_path, most_body_bytes=1 << 16)
    assert send(small, folder_of(RECORDED)).status_code == 413
    small.close()


def test_other_readings_under_the_same_name_are_a_conflict(service: ServiceReceiver) -> None:
    assert send(service, folder_of(RECORDED), id="twice").status_code == 201
    lines = readings(folder_of(RECORDED))
    other = send(service, with_readings(lines[:-1]), id="twice")
    assert other.status_code == 409
    assert "described otherwise" in other.json()["detail"]
