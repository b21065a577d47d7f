"""The main job through the client, on a service of this machine: compare, refit, diagnose, add, restore."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from fingertwin.client import Client, Finding, JobFailedError, ServiceError, Session
from tests.client.services import running

PATIENCE_S = 300.0


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running(tmp_path_factory.mktemp("service"), workers=1) as url:
        yield url


@pytest.fixture
def twin(address: str) -> Iterator[Client]:
    with Client(address) as client:
        yield client


@pytest.fixture
def session(twin: Client) -> Session:
    return twin.upload("DEV-02")


@pytest.fixture
def finding(twin: Client, session: Session) -> Finding:
    """Of a diagnosis by a test before or now."""
    done = [job for job in twin.jobs(session, "done") if job.kind == "diagnose"]
    return twin.job(done[0].id).result() if done else session.diagnose().result(timeout_s=PATIENCE_S)


def test_the_missing_effect_is_found_added_and_taken_back(twin: Client, session: Session) -> None:
    told: list[float] = []
    before = session.compare()
    fit = session.refit().result(lambda share, what: told.append(share), PATIENCE_S)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert fit.outcome == "converged"
    assert session.compare().model == fit.model
    assert session.compare(model=None).rmse_N("validation/tip") == before.rmse_N("validation/tip")

    finding = session.diagnose().result(timeout_s=PATIENCE_S)
    assert (finding.verdict, finding.effects) == ("found", ("hanger_mass",))
    assert finding.probability is not None
    assert finding.probability > 0.9
    assert "hanger_mass" in finding.sentence
    assert finding.ranking[0].name == "hanger_mass"
    mass = finding.ranking[0].parameters[0]
    assert (mass.name, mass.unit) == ("hanger_mass.m0", "g")

    revision = session.add("hanger_mass").result(timeout_s=PATIENCE_S)
    assert revision.parent == fit.model
    assert revision.effects == revision.added == ("hanger_mass",)
    fall = [before.rmse_N("validation/tip"), fit.rmse_N("validation/tip"), revision.rmse_N("validation/tip")]
    assert fall == sorted(fall, reverse=True)
    assert session.compare().rmse_N("validation/tip") == pytest.approx(fall[-1])
    assert [step.rmse_N["validation/tip"] for step in revision.history] == pytest.approx(fall)

    history = session.history()
    assert [r.id for r in history] == [fit.model, revision.id]
    assert [r.in_force for r in history] == [False, True]
    assert [r.id for r in twin.revisions("DEV-02")] == [r.id for r in history]
    assert history[0].restore("the hangers were weighed").in_force
    assert session.compare().model == fit.model
    with pytest.raises(ServiceError) as caught:
        history[0].restore("again")
    assert caught.value.status == 409
    assert twin.revision(revision.id).document()["id"] == revision.id
    assert revision.provenance()["session"] == "DEV-02"

    kinds = [job.kind for job in twin.jobs(session)]
    assert kinds == ["add", "diagnose", "refit"]
    found = twin.job(twin.jobs(session, "done")[1].id).result()
    assert found.sentence == finding.sentence


def test_figures_show_what_they_are_asked_of(twin: Client, session: Session, finding: Finding) -> None:
    assert {"comparison/scatter", "diagnosis/ranking", "revisions/waterfall"} <= set(twin.figures())
    before = session.compare()
    drawn = before.plot().to_json()
    revision = session.add("hanger_mass").result(timeout_s=PATIENCE_S)
    # Another revision stands for the specimen now.
    assert before.plot().to_json() == drawn
    assert session.compare().plot().to_json() != drawn
    assert session.plot_fall().to_json() == revision.plot().to_json()
    assert "hanger_mass" in finding.plot().to_json()
    with pytest.raises(ServiceError) as caught:
        finding.plot("of_nothing")
    assert caught.value.status == 404


def test_next_load_cases_are_ranked_and_frozen(session: Session) -> None:
    plan = session.next_cases(freeze=True, model=None).result(timeout_s=PATIENCE_S)
    assert plan.frozen
    assert plan.cases
    gains = [case.information_nat for case in plan.cases]
    assert gains == sorted(gains, reverse=True)


def test_a_job_that_cannot_be_done_says_why(session: Session) -> None:
    with pytest.raises(JobFailedError) as caught:
        session.add("hanger_mass.of_nothing", model=None).result(timeout_s=PATIENCE_S)
    assert caught.value.state == "failed"
    assert "of_nothing" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(ServiceError, match="no_such_effect"):
        session.add("no_such_effect")


def test_a_cancelled_job_is_no_result(session: Session) -> None:
    job = session.diagnose(thorough=True, model=None).cancel()
    assert job.state == "cancelled"
    with pytest.raises(JobFailedError, match="was cancelled"):
        job.result()
    with pytest.raises(ServiceError) as caught:
        job.cancel()
    assert caught.value.status == 409
