"""What the service is installed from is pinned by its hash, and its unit is held within bounds."""

from __future__ import annotations

import importlib.util
import json
import re
import tomllib
from importlib.metadata import requires
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LINE = re.compile(r"([A-Za-z0-9._-]+)==(\S+) --hash=sha256:[0-9a-f]{64}")


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("lock", ROOT / "docs" / "deploy" / "lock.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pinned(file: str) -> dict[str, str]:
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines()
    found = [re.match(r"([A-Za-z0-9._-]+)==(\S+)", line) for line in lines if not line.startswith("#")]
    return {canonicalize_name(m[1]): m[2] for m in found if m}


def needed(name: str, extra: str = "", seen: frozenset[str] = frozenset()) -> set[str]:
    """What a package needs in a container, and what that needs in turn."""
    out: set[str] = set()
    for text in requires(name) or []:
        asked = Requirement(text)
        here = {"extra": extra, "sys_platform": "linux", "platform_machine": "x86_64", "python_version": "3.11"}
        if asked.marker is None or asked.marker.evaluate(here):
            own = canonicalize_name(asked.name)
            if own not in seen | out:
                out |= {own}
                for more in ["", *asked.extras]:
                    out |= needed(own, more, frozenset(seen | out))
    return out


def test_the_lock_file_holds_all_that_the_service_needs_in_the_versions_that_are_tested() -> None:
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    assert all(LINE.fullmatch(line) for line in lines if not line.startswith("#"))
    locked, tested = pinned("requirements.lock"), pinned("constraints.txt")
    assert locked.items() <= tested.items()
    assert needed("fingertwin", "postgres") <= locked.keys()
    assert "hatchling" in locked


def test_the_build_backend_is_the_one_that_is_locked() -> None:
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]
    assert build["requires"] == [f"hatchling=={pinned('requirements.lock')['hatchling']}"]


def test_the_bill_names_every_component_with_version_and_hash(tool: ModuleType) -> None:
    own = {"metadata": {"name": "fingertwin", "version": "0.1.0"}, "download_info": {"dir_info": {}}}
    other = {
        "metadata": {"name": "PyYAML", "version": "6.0", "license": "MIT"},
        "download_info": {"archive_info": {"hashes": {"sha256": "a" * 64}}},
    }
    body = json.loads(tool.bill([own, other]))
    (component,) = body["components"]
    assert (body["bomFormat"], body["metadata"]["component"]["name"]) == ("CycloneDX", "fingertwin")
    assert (component["purl"], component["hashes"][0]["content"]) == ("pkg:pypi/pyyaml@6.0", "a" * 64)
    assert tool.lock([own, other]).splitlines()[1:] == [f"PyYAML==6.0 --hash=sha256:{'a' * 64}"]


def test_the_unit_is_held_within_bounds_and_reaches_this_machine_alone() -> None:
    lines = (ROOT / "docs" / "deploy" / "fingertwin.service").read_text(encoding="utf-8").splitlines()
    settings = dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))
    assert {"MemoryMax", "TasksMax", "LimitNOFILE"} <= settings.keys()
    assert (settings["IPAddressDeny"], settings["IPAddressAllow"]) == ("any", "localhost")


def test_the_base_image_is_of_one_version_of_python_and_of_the_system() -> None:
    text = (ROOT / "docs" / "deploy" / "Dockerfile").read_text(encoding="utf-8")
    (base,) = re.findall(r"^ARG BASE=(\S+)$", text, re.MULTILINE)
    assert re.fullmatch(r"python:3\.11\.\d+-slim-[a-z]+@sha256:[0-9a-f]{64}", base)
    assert re.findall(r"^FROM (\S+)$", text, re.MULTILINE) == ["${BASE}"]
    assert "--require-hashes -r requirements.lock" in text
