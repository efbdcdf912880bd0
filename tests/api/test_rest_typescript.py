"""The TypeScript twin of the REST interface: every schema has one, and new routes come along."""

from __future__ import annotations

from typing import Annotated, Literal

import pytest
from fastapi import APIRouter, Body, FastAPI
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, Field

from server.api.openapi import openapi_document
from server.api.openapi_document import describe
from server.api.rest_typescript import declaration_text, rest_text, type_text


class Sent(BaseModel):
    """What is sent."""

    size: float
    name: str = ""


class Told(BaseModel):
    """What is told; a comment that ends here: */ does not."""

    kind: Literal["told"] = "told"
    place: Annotated[list[float], Field(min_length=2, max_length=2)]
    within: Told | None


def _text(router: APIRouter) -> str:
    web = FastAPI()
    web.include_router(router)
    return rest_text(describe(web))


def test_a_route_comes_with_what_it_is_asked_and_what_it_answers() -> None:
    router = APIRouter(prefix="/api/v1")

    @router.post("/things/{thing_id}")
    async def change(thing_id: str, sent: Sent, loud: bool = False) -> list[Told]:
        """Change a thing.

        And say so.
        """
        raise AssertionError(thing_id, sent, loud)

    text = _text(router)
    assert (
        "  /** Change a thing. */\n"
        '  readonly "POST /things/{thing_id}": { readonly query: { readonly loud?: boolean };'
        " readonly body: Sent; readonly answer: readonly Told[] };\n"
    ) in text
    # What is sent may be left out where the server knows better; what it tells is all there.
    assert "  readonly size: number;\n  readonly name?: string;\n" in text
    assert (
        "/** What is told; a comment that ends here: * / does not. */\n"
        "export interface Told {\n"
        '  readonly kind: "told";\n'
        "  readonly place: readonly [number, number];\n"
        "  readonly within: Told | null;\n"
        "}"
    ) in text


def test_what_is_no_json_has_no_place_there() -> None:
    router = APIRouter(prefix="/api/v1")

    @router.get("/text", response_class=PlainTextResponse)
    async def text() -> str:
        """Return a text."""
        return ""

    @router.post("/picture")
    async def take(picture: Annotated[bytes, Body(media_type="image/jpeg")]) -> Told:
        """Take a picture."""
        raise AssertionError(picture)

    made = _text(router)
    assert "GET /text" not in made
    assert "POST /picture" not in made
    assert "Told" not in made


def test_every_route_that_speaks_json_is_there() -> None:
    document = openapi_document()
    text = rest_text(document)
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            answers = [a for status, a in operation["responses"].items() if status.startswith("2")]
            spoken = all(
                "application/json" in a.get("content", {"application/json"}) for a in answers
            )
            asked = operation.get("requestBody", {}).get("content", {"application/json"})
            here = path.startswith("/api/v1/") and spoken and "application/json" in asked
            name = f'"{method.upper()} {path.removeprefix("/api/v1")}"'
            assert (name in text) == here, name
    # Neither errors nor what only errors are made of: the browser reads those with more caution.
    assert "Problem" not in text


@pytest.mark.parametrize(
    ("schema", "text"),
    [
        ({"type": "string", "format": "date-time"}, "string"),
        ({"$ref": "#/components/schemas/Thing-Input"}, "ThingInput"),
        ({"anyOf": [{"type": "integer"}, {"type": "number"}, {"type": "null"}]}, "number | null"),
        ({"enum": ["a", 'b"'], "type": "string"}, '"a" | "b\\""'),
        ({"const": "a", "type": "string"}, '"a"'),
        ({"type": "array", "items": {"enum": ["a", "b"]}}, 'readonly ("a" | "b")[]'),
        ({"type": "array", "items": {}, "maxItems": 2}, "readonly unknown[]"),
        (
            {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2},
            "readonly [number, number]",
        ),
        (
            {"type": "array", "prefixItems": [{"type": "string"}, {"type": "null"}]},
            "readonly [string, null]",
        ),
        ({"type": "object"}, "Readonly<Record<string, unknown>>"),
        (
            {"type": "object", "additionalProperties": {"type": "number"}},
            "Readonly<Record<string, number>>",
        ),
        ({"title": "Anything"}, "unknown"),
    ],
)
def test_types(schema: dict[str, object], text: str) -> None:
    assert type_text(schema) == text


@pytest.mark.parametrize("schema", [{"type": "tuple"}, {"allOf": []}, {"type": ["string", "null"]}])
def test_schemas_without_a_twin_are_refused(schema: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="no TypeScript twin"):
        type_text(schema)


def test_a_schema_without_fields_is_a_type() -> None:
    schema: dict[str, object] = {"description": "Which.", "type": "string", "enum": ["a", "b"]}
    text = declaration_text("Which", schema, whole=True)
    assert text == '/** Which. */\nexport type Which = "a" | "b";'
