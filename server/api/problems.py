"""Errors as RFC 9457 problem documents, whatever raised them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from http import HTTPStatus

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from server.mission.commands import RefusedError, UnknownError

MEDIA_TYPE = "application/problem+json"


class Problem(BaseModel):
    """RFC 9457 problem document.

    ``code`` is a stable word for programs, ``errors`` names the faulty fields of a 422.
    """

    type: str = "about:blank"
    title: str
    status: int
    detail: str | None = None
    code: str | None = None
    errors: list[dict[str, str]] | None = None


class ProblemError(Exception):
    """Ends a request with a problem document.

    Attributes:
        status: HTTP status.
        detail: What is wrong, for people.
        code: Stable word for programs.
    """

    def __init__(self, status: int, detail: str, code: str | None = None) -> None:
        super().__init__(detail)
        self.status = status
        self.detail = detail
        self.code = code


def problem_response(
    status: int,
    detail: str | None = None,
    *,
    code: str | None = None,
    errors: list[dict[str, str]] | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """Return the problem document of an HTTP status."""
    try:
        title = HTTPStatus(status).phrase
    except ValueError:
        title = "Error"
    problem = Problem(title=title, status=status, detail=detail, code=code, errors=errors)
    return JSONResponse(
        problem.model_dump(exclude_none=True),
        status_code=status,
        headers=dict(headers or {}),
        media_type=MEDIA_TYPE,
    )


def install_problems(web: FastAPI) -> None:
    """Make every error of ``web`` a problem document."""

    async def refused(_: Request, error: Exception) -> JSONResponse:
        return problem_response(409, str(error), code="refused")

    async def unknown(_: Request, error: Exception) -> JSONResponse:
        return problem_response(404, str(error), code="unknown")

    async def known(_: Request, error: Exception) -> JSONResponse:
        if not isinstance(error, ProblemError):
            raise error
        return problem_response(error.status, error.detail, code=error.code)

    async def http(_: Request, error: Exception) -> JSONResponse:
        if not isinstance(error, HTTPException):
            raise error
        phrase = HTTPStatus(error.status_code).phrase
        detail = error.detail if error.detail != phrase else None
        return problem_response(error.status_code, detail, headers=error.headers)

    async def invalid(_: Request, error: Exception) -> JSONResponse:
        if not isinstance(error, RequestValidationError):
            raise error
        errors = [
            {"field": ".".join(str(part) for part in e["loc"]), "detail": str(e["msg"])}
            for e in error.errors()
        ]
        return problem_response(422, "The request is not valid.", code="invalid", errors=errors)

    async def broken(_: Request, __: Exception) -> JSONResponse:
        # The traceback is in the log; it is not for whoever asked.
        return problem_response(500, "The server failed; its log says why.", code="failed")

    web.add_exception_handler(RefusedError, refused)
    web.add_exception_handler(UnknownError, unknown)
    web.add_exception_handler(ProblemError, known)
    web.add_exception_handler(HTTPException, http)
    web.add_exception_handler(RequestValidationError, invalid)
    web.add_exception_handler(Exception, broken)


def described(*statuses: int) -> dict[int | str, dict[str, object]]:
    """Return the OpenAPI description of the problem documents a path may answer with."""
    return {
        status: {
            "description": HTTPStatus(status).phrase,
            "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
        }
        for status in (401, *statuses)
    }


def json_safe(value: object) -> object:
    """Return ``value`` with every number JSON cannot carry (NaN, infinities) replaced by None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): json_safe(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_safe(item) for item in value]
    return value
