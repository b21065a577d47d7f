"""Write what the service is installed from: a lock file with hashes, and a bill of materials (CycloneDX 1.6).

    python docs/deploy/lock.py requirements.lock        names, versions and SHA-256, for pip's --require-hashes
    python docs/deploy/lock.py dist/fingertwin.cdx.json the bill of materials

Both come from what pip reports that it would install here, under constraints.txt. A wheel's hash is that of this system
and Python: the lock file in the repository is for the container's, Linux on x86-64 with Python 3.11.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
# The service with PostgreSQL, and what builds its wheel.
ASKED = (".[postgres]", "hatchling")
Installed = list[dict[str, Any]]


def reported() -> Installed:
    """Ask pip what it would install; nothing is."""
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--quiet", "--report", "-"]
    command += ["--disable-pip-version-check", "-c", "constraints.txt", *ASKED]
    done = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE)  # noqa: S603
    found: Installed = json.loads(done.stdout)["install"]
    return sorted(found, key=lambda one: str(one["metadata"]["name"]).lower())


def sha256_of(one: dict[str, Any]) -> str | None:
    """The SHA-256 of the file that a package comes from; None for this very software."""
    found: dict[str, str] = one["download_info"].get("archive_info", {}).get("hashes", {})
    return found.get("sha256")


def lock(installed: Installed) -> str:
    """Return the lock file."""
    major, minor, _ = platform.python_version_tuple()
    here = f"{platform.system()} {platform.machine()}, Python {major}.{minor}"
    pins = [(one["metadata"], sha256_of(one)) for one in installed]
    lines = [f"{about['name']}=={about['version']} --hash=sha256:{digest}\n" for about, digest in pins if digest]
    return f"# Made by make lock, for {here}: the service with PostgreSQL, and what builds its wheel.\n" + "".join(
        lines
    )


def bill(installed: Installed) -> str:
    """Return the bill of materials."""
    own = next(one["metadata"] for one in installed if sha256_of(one) is None)
    body = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {"type": "application", "name": own["name"], "version": own["version"]}},
        "components": [_component(one["metadata"], digest) for one in installed if (digest := sha256_of(one))],
    }
    return json.dumps(body, indent=1, ensure_ascii=False) + "\n"


def _component(about: dict[str, Any], digest: str) -> dict[str, Any]:
    name, version = about["name"], about["version"]
    out: dict[str, Any] = {
        "type": "library",
        "name": name,
        "version": version,
        "purl": f"pkg:pypi/{name.lower().replace('_', '-')}@{version}",
        "hashes": [{"alg": "SHA-256", "content": digest}],
    }
    if expression := about.get("license_expression"):
        out["licenses"] = [{"expression": expression}]
    elif (words := about.get("license")) and len(words) < 80:
        out["licenses"] = [{"license": {"name": words}}]
    return out


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.parent.mkdir(parents=True, exist_ok=True)
    write = lock if target.suffix == ".lock" else bill
    target.write_text(write(reported()), encoding="utf-8")
