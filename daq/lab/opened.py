"""A lab's recording, opened as what its first bytes say it is."""

from __future__ import annotations

from pathlib import Path

from daq.errors import ReadingsError
from daq.lab.c3d import C3D, C3dChannels
from daq.lab.channels import LabChannels
from daq.lab.hdf5 import HDF5, MATLAB_HDF5, Hdf5Channels
from daq.lab.lvm import LVM_BYTES, LvmChannels, is_lvm
from daq.lab.tables import ExcelChannels, ParquetChannels
from daq.lab.tdms import TDMS, TdmsChannels
from daq.lab.text import TextChannels
from daq.recordings.readings import first_bytes

OLD_EXCEL = b"\xd0\xcf\x11\xe0"
# Of files whose readers are C libraries that a hostile file may crash, and of those whose reader makes room for every
# cell up to one far away: a service does not open them.
NOT_FOR_A_SERVICE = (HDF5, MATLAB_HDF5, C3D, OLD_EXCEL)


def open_channels(path: str | Path) -> LabChannels:
    """Read the channels of a recording; its first bytes tell its format.

    Args:
        path: of a TDMS, LVM, Parquet, HDF5, C3D or Excel file, or of text with columns (also gzipped).

    Raises:
        ReadingsError: it is none of these, or torn.
    """
    file = Path(path)
    start = first_bytes(file, LVM_BYTES, "a recording")
    if start[:4] in TDMS:
        return TdmsChannels(file)
    if is_lvm(start):
        return LvmChannels(file)
    if start.startswith(b"PAR1"):
        return ParquetChannels(file)
    if start.startswith((HDF5, MATLAB_HDF5)):
        return Hdf5Channels(file)
    if start.startswith(C3D):
        return C3dChannels(file)
    if start.startswith((b"PK\x03\x04", OLD_EXCEL)):
        return ExcelChannels(file)
    if start.startswith(b"MATLAB 5.0"):
        raise ReadingsError(f"{file.name} is a MATLAB 5 file", "an HDF5 file", "Save it with -v7.3, or as CSV")
    if start.startswith(b"SQLite format 3"):
        raise ReadingsError(f"{file.name} is a journal", "a recording", "Export it: fingertwin journal export")
    return TextChannels(file)
