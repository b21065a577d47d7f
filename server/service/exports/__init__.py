"""Sessions and models as files: exports, session folders, reports. It imports `figures` and what stands below."""
