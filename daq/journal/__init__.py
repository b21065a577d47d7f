"""The bench's journal: one SQLite file that survives a pulled plug; written, read, checked, recovered, exported."""
