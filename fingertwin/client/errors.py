"""What can go wrong between a program and the service.

InputError                      what was given cannot be used
├── ServiceError                the service refused, or failed; `status` is that of HTTP
│   └── JobFailedError          a refit, diagnosis or other job ended without a result
└── ServiceUnreachableError     no service answers at the address
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from daq.errors import InputError

if TYPE_CHECKING:
    import httpx

_SHOWN = 300


class ServiceError(InputError):
    """The service refused, or failed: one line of what was found, what was expected, what to do.

    Args:
        status: of HTTP, such as 404.
        found: what was found.
        expected: what was expected.
        remedy: what to do.
        errors: each fault of what was sent, where the service lists them.
        problem: the whole `application/problem+json`.
    """

    def __init__(
        self,
        status: int,
        found: str,
        expected: str = "",
        remedy: str = "",
        *,
        errors: Sequence[Mapping[str, Any]] = (),
        problem: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(found, expected, remedy)
        self.status, self.errors, self.problem = status, tuple(errors), dict(problem or {})

    @classmethod
    def of_problem(cls, problem: Mapping[str, Any], status: int) -> ServiceError:
        """Of a problem as the service tells it."""
        found = str(problem.get("found") or problem.get("detail") or problem.get("title") or f"status {status}")
        expected, remedy = (str(problem.get(key) or "") for key in ("expected", "remedy"))
        errors = problem.get("errors")
        return cls(
            status, found[:_SHOWN], expected, remedy, errors=errors if isinstance(errors, list) else (), problem=problem
        )

    @classmethod
    def of_answer(cls, response: httpx.Response) -> ServiceError:
        """Of an answer that is no success."""
        try:
            problem = response.json()
        except ValueError:
            problem = None
        if isinstance(problem, dict) and (problem.get("detail") or problem.get("title")):
            return cls.of_problem(problem, response.status_code)
        found = f"{_origin(response)} answers {response.status_code} {response.reason_phrase}"
        return cls(response.status_code, found, "the model service", "Correct the address")


class JobFailedError(ServiceError):
    """A job ended without a result: it failed, or it was cancelled.

    Attributes:
        job: its id.
        state: `failed` or `cancelled`.
    """

    def __init__(self, job: str, kind: str, state: str, problem: Mapping[str, Any] | None) -> None:
        told = problem or {}
        status = told.get("status")
        reason = str(told.get("found") or told.get("detail") or "")
        found = f"{kind} {job} was cancelled" if state == "cancelled" else f"{kind} {job} failed"
        super().__init__(
            status if isinstance(status, int) else 409,
            f"{found}: {reason}" if reason else found,
            str(told.get("expected") or ""),
            str(told.get("remedy") or ""),
            problem=problem,
        )
        self.job, self.state = job, state


class ServiceUnreachableError(InputError):
    """No service answers at the address."""

    @classmethod
    def of(cls, url: str, why: BaseException) -> ServiceUnreachableError:
        """Of what went wrong on the way."""
        reason = str(why).strip().rstrip(".") or type(why).__name__
        return cls(
            f"no service answers at {url} ({reason[:_SHOWN]})",
            "a running model service",
            "Start one with `fingertwin serve`, or correct the address",
        )


def _origin(response: httpx.Response) -> str:
    url = response.request.url
    return f"{url.scheme}://{url.netloc.decode('ascii', 'replace')}"
