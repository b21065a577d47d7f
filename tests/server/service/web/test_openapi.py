"""The OpenAPI document: its own laws, and that the service answers as it says."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema_rs import Draft202012Validator

from server.service.app import create_app
from server.service.settings import Settings
from server.service.web.openapi import methods_of
from server.service.web.problems import PROBLEM
from tests.server.service.asking import asked, prepared
from tests.server.service.postgres import postgres_url
from tests.server.service.processes import running, whole

REFUSALS = {"400", "401", "403", "404", "405", "409", "413", "414", "415", "421", "422", "429", "500", "503"}
# A number has its unit in its name or its description, or it is none of a quantity: a count, a share, a ratio.
UNIT = re.compile(
    r"_(N|Nmm|g|deg|s|mm|pct|hz|m_s2|per_s|ms|bytes)$|\[[^\]]+\]|share|factor|percent|norm|unit|bytes|seconds",
    re.IGNORECASE,
)
Found = dict[str, Any]


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> Found:
    app = create_app(Settings(data=tmp_path_factory.mktemp("data")))
    found: Found = app.openapi()
    return found


def operations(document: Found) -> Iterator[tuple[str, Found]]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield f"{method.upper()} {path}", operation


def test_every_operation_is_described_and_named_once(document: Found) -> None:
    bare = [
        where for where, o in operations(document) if not (o.get("summary") and o.get("description") and o.get("tags"))
    ]
    assert not bare
    names = [o["operationId"] for _, o in operations(document)]
    assert len(set(names)) == len(names)
    for where, operation in operations(document):
        inside = {p["name"] for p in operation.get("parameters", ()) if p["in"] == "path"}
        assert inside == set(re.findall(r"{(\w+)}", where)), where


def test_every_answer_names_its_schema(document: Found) -> None:
    """Documents and exports are files, which say their own format."""
    silent = [
        where
        for where, content in json_answers(document)
        if not where.endswith(("/document", "/export")) and "schema" not in resolved(document, content)["properties"]
    ]
    assert silent == []


def test_every_body_has_an_example(document: Found) -> None:
    """What is sent and what is answered as JSON, beside it or in its form among the components."""
    sent = [
        (where, content)
        for where, operation in operations(document)
        for kind, content in operation.get("requestBody", {}).get("content", {}).items()
        if kind == "application/json"
    ]
    bare = [
        where
        for where, content in [*sent, *json_answers(document)]
        if "example" not in content and not {"example", "examples"} & set(resolved(document, content))
    ]
    assert bare == []


def json_answers(document: Found) -> Iterator[tuple[str, Found]]:
    """What every success of every operation answers as JSON."""
    for where, operation in operations(document):
        for status, answer in operation["responses"].items():
            if status[0] == "2" and "application/json" in answer.get("content", {}):
                yield where, answer["content"]["application/json"]


def resolved(document: Found, content: Found) -> Found:
    """The schema of what is sent, also where it stands among the components."""
    schema: Found = content["schema"]
    named: Found = document["components"]["schemas"].get(schema.get("$ref", "").rpartition("/")[2], schema)
    return named


def test_every_refusal_is_documented_as_a_problem(document: Found) -> None:
    for where, operation in operations(document):
        answers = operation["responses"]
        assert set(answers) >= REFUSALS, where
        for status, answer in answers.items():
            if status[0] in "45":
                assert list(answer["content"]) == [PROBLEM], (where, status)
                assert answer["content"][PROBLEM]["schema"] == {"$ref": "#/components/schemas/Problem"}, (where, status)
            assert "Successful Response" not in answer["description"] or status[0] == "2"


def test_every_quantity_says_its_unit(document: Found) -> None:
    silent = []
    for name, schema in document["components"]["schemas"].items():
        for key, entry in schema.get("properties", {}).items():
            kinds = {entry.get("type"), *(e.get("type") for e in entry.get("anyOf", ()))}
            if "number" in kinds and not UNIT.search(f"{entry.get('description', '')}") and not UNIT.search(key):
                silent.append(f"{name}.{key}: {entry.get('description', '')}")
    assert not silent


def test_every_whole_number_in_an_address_has_a_greatest_value(document: Found) -> None:
    parameters = [(where, p) for where, o in operations(document) for p in o.get("parameters", ())]
    kinds = [
        (f"{where}: {p['name']}", kind) for where, p in parameters for kind in p["schema"].get("anyOf", [p["schema"]])
    ]
    whole = [(where, kind) for where, kind in kinds if kind.get("type") == "integer"]
    assert whole
    assert not [where for where, kind in whole if "maximum" not in kind]


def test_every_example_is_as_its_schema_says(document: Found) -> None:
    tried = 0
    for where, schema, example in examples(document, "#"):
        whole_schema = schema | {"components": document["components"]}
        faults = list(Draft202012Validator(whole_schema).iter_errors(example))
        assert not faults, (where, faults[0].message)
        tried += 1
    assert tried > 30


def examples(value: Any, where: str) -> Iterator[tuple[str, Found, Any]]:
    """Every schema with an example, wherever it stands; that of a media type or a parameter has its schema beside."""
    if isinstance(value, dict):
        schema = value["schema"] if isinstance(value.get("schema"), dict) else value
        if "example" in value:
            yield where, schema, value["example"]
        for example in value["examples"] if isinstance(value.get("examples"), list) else ():
            yield where, schema, example
        for key, item in value.items():
            if key not in ("example", "examples"):
                yield from examples(item, f"{where}/{key}")
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from examples(item, f"{where}/{k}")


def test_an_address_takes_the_methods_of_its_most_exact_template(document: Found) -> None:
    assert methods_of(document, "/api/v1/sessions/S1/cases") == ["GET", "POST"]
    assert methods_of(document, "/api/v1/effects/check") == ["POST"]
    assert methods_of(document, "/api/v1/effects/worn_pulley") == ["GET"]
    assert methods_of(document, "/api/v1/nothing") == []


@pytest.mark.parametrize("database", ["sqlite", pytest.param("postgresql", marks=pytest.mark.full)])
def test_the_service_answers_as_documented(database: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if database == "postgresql":
        monkeypatch.setenv("FINGERTWIN_DATABASE_URL", postgres_url())
    with running(whole(tmp_path)) as service:
        with service.client() as client:
            ids = prepared(client, refit=False)
        tally = asked(service.address(), ids, examples=1, seed=1, phases=("fuzzing",))
        assert not tally.errors
        assert not tally.failures
        assert len(tally.cases) > 50
        assert max(tally.statuses) < 500
        assert "Traceback" not in service.log
