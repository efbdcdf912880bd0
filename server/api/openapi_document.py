"""The OpenAPI document: what FastAPI knows of the routes, and what it cannot know of the wall.

That is the problem documents, how to show a token, which role a request needs, and the header
``Idempotency-Key``, which middlewares see to.
"""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from server.api.door import OPEN_PATHS, needed_role
from server.api.idempotency import HEADER, LONGEST_KEY
from server.api.problems import FieldError, Problem, described

_KEY = {
    "name": HEADER,
    "in": "header",
    "required": False,
    "description": "The same request with the same key is carried out once; its answer is given"
    " again, for a day.",
    "schema": {
        "type": "string",
        "minLength": 1,
        "maxLength": LONGEST_KEY,
        "pattern": "^[!-~]+$",
    },
}
_SCHEMES = {
    "bearer": {
        "type": "http",
        "scheme": "bearer",
        "description": "A token; browsers exchange it for a session cookie.",
    }
}


def describe(web: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI document of ``web``."""
    document = get_openapi(title=web.title, version=web.version, routes=web.routes)
    components = document.setdefault("components", {})
    components["securitySchemes"] = _SCHEMES
    schemas = components.setdefault("schemas", {})
    for model in (Problem, FieldError):
        schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
        schema.pop("$defs", None)
        schemas[model.__name__] = schema
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            _complete(operation, method.upper(), path)
    schemas.pop("HTTPValidationError", None)
    schemas.pop("ValidationError", None)
    return document


def _complete(operation: dict[str, Any], method: str, path: str) -> None:
    answers = operation.setdefault("responses", {})
    # FastAPI announces its own 422 where none was described; ours are problem documents too.
    if "application/json" in answers.get("422", {}).get("content", {}):
        answers["422"] = described(422)[422]
    if path in OPEN_PATHS:
        return
    operation["security"] = [{"bearer": []}]
    operation["description"] = (
        f"{operation.get('description', '')}\n\nNeeds the role {needed_role(method, path)}."
    ).strip()
    added: list[int] = []
    if method == "POST":
        operation.setdefault("parameters", []).append(_KEY)
        added += [409, 422]
    if "requestBody" in operation:
        added += [400, 413]
    for status in added:
        answers.setdefault(str(status), described(status)[status])
    # The metrics, for one, are behind the door without knowing of it.
    for status in (401, 403):
        answers.setdefault(str(status), described()[status])
