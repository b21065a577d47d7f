"""What a service exports, read back."""

from __future__ import annotations

import csv
import io
import zipfile
from typing import Any

import h5py
import pyarrow.parquet
from scipy.io import loadmat

from tests.server.service.running import ServiceReceiver

OF_PREDICTIONS = ("predicted_", "residual_")


def exported(service: ServiceReceiver, session: str, file_format: str, **asked: str) -> bytes:
    answer = service.client().get(f"/api/v1/sessions/{session}/export", params={"format": file_format} | asked)
    assert answer.status_code == 200, answer.text
    assert answer.headers["Content-Disposition"].startswith(f'attachment; filename="{session}')
    assert int(answer.headers["Content-Length"]) == len(answer.content)
    content: bytes = answer.content
    return content


def members(archive: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(archive)) as found:
        assert found.testzip() is None
        return {name: found.read(name) for name in found.namelist()}


def datasets(content: bytes) -> dict[str, Any]:
    with h5py.File(io.BytesIO(content)) as file:
        groups = {g: file[g] for g in ("cases", "readings") if g in file}
        return {f"{g}/{name}": group[name][()] for g, group in groups.items() for name in group}


def cells(content: bytes) -> dict[str, list[Any]]:
    columns: dict[str, list[Any]] = pyarrow.parquet.read_table(io.BytesIO(content)).to_pydict()
    return columns


def from_csv(content: bytes) -> dict[str, list[Any]]:
    rows = list(csv.DictReader(io.StringIO(content.decode())))
    numbers = [k for k in rows[0] if k.startswith(OF_PREDICTIONS) or k == "z"]
    return {k: [(float(r[k]) if r[k] else None) if k in numbers else r[k] for r in rows] for k in rows[0]}


def from_mat(content: bytes) -> dict[str, Any]:
    found: dict[str, Any] = loadmat(io.BytesIO(content), simplify_cells=True)  # type: ignore[arg-type]
    return found
