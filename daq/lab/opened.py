"""A lab's recording, opened as what its first bytes say it is."""

from __future__ import annotations

from pathlib import Path

from daq.errors import ReadingsError
from daq.lab.channels import LabChannels
from daq.lab.lvm import LvmChannels
from daq.lab.tables import ExcelChannels, ParquetChannels
from daq.lab.tdms import TDMS, TdmsChannels
from daq.lab.text import TextChannels
from daq.recordings.readings import first_bytes

_LVM = b"LabVIEW Measurement"


def open_channels(path: str | Path) -> LabChannels:
    """Read what channels a recording has; its kind is told by its first bytes.

    Args:
        path: of a TDMS, LVM, Parquet or Excel file, or of text with columns (also gzipped).

    Raises:
        ReadingsError: it is none of these, or torn.
    """
    file = Path(path)
    start = first_bytes(file, 32, "a recording")
    if start[:4] in TDMS:
        return TdmsChannels(file)
    if start.removeprefix(b"\xef\xbb\xbf").startswith(_LVM):
        return LvmChannels(file)
    if start.startswith(b"PAR1"):
        return ParquetChannels(file)
    if start.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        return ExcelChannels(file)
    if start.startswith(b"SQLite format 3"):
        raise ReadingsError(f"{file.name} is a journal", "a recording", "Export it: fingertwin journal export")
    return TextChannels(file)
