"""Recordings that labs have already (TDMS, LVM), read through a mapping that a person confirmed."""
