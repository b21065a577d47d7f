"""The finger's digital twin for other programs: `fingertwin.client` asks a running model service."""
