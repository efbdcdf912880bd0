"""Errors as RFC 9457 problem documents, whatever raised them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from http import HTTPStatus

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from server.mission.commands import RefusedError, UnknownError

MEDIA_TYPE = "application/problem+json"
TYPE_PREFIX = "urn:dronerf:problem:"

# Every code there is: programs may rely on it, and on the problem type that ends in it.
CODES: Mapping[str, str] = {
    "malformed": "The request is not HTTP as it should be, or its body is no JSON.",
    "unauthorized": "No token was shown, or none that opens this console.",
    "forbidden": "The token's role does not allow it.",
    "origin": "A page of another origin tried to change something.",
    "unknown": "The drone, capture, job, token or file that was named does not exist.",
    "not_found": "There is nothing at this path.",
    "no_metrics": "The capture has not been judged yet.",
    "no_picture": "No picture has come from the drone yet.",
    "no_scene": "This console runs without a 3D scene.",
    "method_not_allowed": "The path knows other methods; the header Allow names them.",
    "refused": "It cannot be done now; the detail says why.",
    "not_in_command": "Another browser is in command of the drones.",
    "key_in_use": "A request with this Idempotency-Key is still being carried out.",
    "key_reused": "This Idempotency-Key was used for another request.",
    "changed": "The file is no longer the one that If-Match names.",
    "no_range": "The file has no such range of bytes.",
    "too_large": "The body is larger than any request needs.",
    "invalid": "A value is missing, of a wrong type or out of bounds.",
    "too_many_attempts": "Too many wrong tokens from this address; Retry-After says when again.",
    "scene_down": "The 3D scene does not answer.",
    "failed": "The server failed; its log says why.",
    "other": "None of the above; the status says what.",
}
_CODE_FROM_STATUS = {
    400: "malformed",
    401: "unauthorized",
    403: "forbidden",
    404: "not_found",
    405: "method_not_allowed",
    409: "refused",
    412: "changed",
    413: "too_large",
    416: "no_range",
    422: "invalid",
    429: "too_many_attempts",
    500: "failed",
}


class FieldError(BaseModel):
    """A faulty field and what is wrong with it."""

    field: str
    detail: str


class Problem(BaseModel):
    """RFC 9457 problem document; ``errors`` names the faulty fields of a 422.

    ``code`` is a stable word for programs; ``type`` is that word as a URI.
    """

    type: str = Field(json_schema_extra={"enum": [TYPE_PREFIX + code for code in CODES]})
    title: str
    status: int
    detail: str | None = None
    code: str = Field(json_schema_extra={"enum": list(CODES)})
    errors: list[FieldError] | None = None


class ProblemError(Exception):
    """Ends a request with a problem document.

    Attributes:
        status: HTTP status.
        detail: What is wrong, for people.
        code: Stable word for programs, one of ``CODES``.
        headers: Headers of the answer.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        code: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.detail = detail
        self.code = code
        self.headers = headers


def problem_response(
    status: int,
    detail: str | None = None,
    *,
    code: str | None = None,
    errors: list[FieldError] | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """Return the problem document of an HTTP status; without ``code`` the status's usual one."""
    try:
        title = HTTPStatus(status).phrase
    except ValueError:
        title = "Error"
    code = code or _CODE_FROM_STATUS.get(status, "other")
    problem = Problem(
        type=TYPE_PREFIX + code, title=title, status=status, detail=detail, code=code, errors=errors
    )
    return JSONResponse(
        problem.model_dump(exclude_none=True),
        status_code=status,
        headers=dict(headers or {}),
        media_type=MEDIA_TYPE,
    )


def install_problems(web: FastAPI, allowed: Callable[[str], str | None]) -> None:
    """Make every error of ``web`` a problem document.

    ``allowed`` gives the methods of a path, for the header ``Allow``.
    """

    async def refused(_: Request, error: Exception) -> JSONResponse:
        return problem_response(409, str(error), code="refused")

    async def unknown(_: Request, error: Exception) -> JSONResponse:
        return problem_response(404, str(error), code="unknown")

    async def known(_: Request, error: Exception) -> JSONResponse:
        if not isinstance(error, ProblemError):
            raise error
        return problem_response(error.status, error.detail, code=error.code, headers=error.headers)

    async def http(request: Request, error: Exception) -> JSONResponse:
        if not isinstance(error, HTTPException):
            raise error
        phrase = HTTPStatus(error.status_code).phrase
        detail = error.detail if error.detail != phrase else None
        headers = dict(error.headers or {})
        methods = allowed(request.url.path) if error.status_code == 405 else None
        if methods is not None:
            headers["Allow"] = methods  # Of all routes at this path; each knows its own only.
        return problem_response(error.status_code, detail, headers=headers)

    async def invalid(_: Request, error: Exception) -> JSONResponse:
        if not isinstance(error, RequestValidationError):
            raise error
        errors = [
            FieldError(field=".".join(str(part) for part in e["loc"]), detail=str(e["msg"]))
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
        for status in (401, 403, *statuses)
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
