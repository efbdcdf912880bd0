"""Print the TypeScript twin of the REST interface: ``python -m server.api.rest_typescript``.

It is made of the OpenAPI document, so a new route comes along by itself: one exported interface per
schema, and ``Routes``, what each route of ``/api/v1`` is asked with and answers in JSON. Files and
pictures have no place there, nor have problem documents, which the browser reads with more caution.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from typing import Any

from server.api.openapi import openapi_document

_ROOT = "/api/v1"
_JSON = "application/json"
_REFERENCE = "#/components/schemas/"
# A list of so many items or fewer that can have no other length is a tuple.
_LONGEST_TUPLE = 8

_HEADER = """\
// Generated from the server's routes by `make openapi`. Do not edit.
// Units are SI, times are seconds, moments are ISO 8601 UTC.
"""

_PLAIN = {
    "string": "string",
    "integer": "number",
    "number": "number",
    "boolean": "boolean",
    "null": "null",
}


def type_text(schema: dict[str, Any]) -> str:
    """Return the TypeScript type of a JSON schema.

    Raises:
        ValueError: The schema has no twin here.
    """
    if "$ref" in schema:
        return _identifier(schema["$ref"].removeprefix(_REFERENCE))
    for choice in ("anyOf", "oneOf"):
        if choice in schema:
            return " | ".join(dict.fromkeys(type_text(each) for each in schema[choice]))
    if "const" in schema or "enum" in schema:
        values = schema["enum"] if "enum" in schema else [schema["const"]]
        return " | ".join(json.dumps(value, ensure_ascii=False) for value in values)
    kind = schema.get("type")
    if kind == "array":
        return _list_text(schema)
    if kind == "object" and "properties" not in schema:
        values = schema.get("additionalProperties", True)
        return f"Readonly<Record<string, {'unknown' if values is True else type_text(values)}>>"
    if isinstance(kind, str) and kind in _PLAIN:
        return _PLAIN[kind]
    if schema.keys() <= {"title", "description", "default"}:
        return "unknown"
    raise ValueError(f"no TypeScript twin for {schema!r}")


def _identifier(name: str) -> str:
    return re.sub(r"\W", "", name)


def _list_text(schema: dict[str, Any]) -> str:
    least, most = schema.get("minItems"), schema.get("maxItems")
    if "prefixItems" in schema:
        return f"readonly [{', '.join(type_text(each) for each in schema['prefixItems'])}]"
    item = type_text(schema.get("items", {}))
    if least == most and most is not None and 0 < most <= _LONGEST_TUPLE:
        return f"readonly [{', '.join([item] * most)}]"
    return f"readonly ({item})[]" if " " in item else f"readonly {item}[]"


def declaration_text(name: str, schema: dict[str, Any], *, whole: bool) -> str:
    """Return a schema as an exported type, with its description as the comment.

    Args:
        name: Its name.
        schema: A JSON schema.
        whole: True where every field is there, false where one with a default may be left out.
    """
    doc = _comment(schema.get("description", ""))
    if "properties" not in schema:
        return f"{doc}\nexport type {_identifier(name)} = {type_text(schema)};"
    required = schema.get("required", [])
    fields = [
        f"  readonly {field}{'' if whole or field in required else '?'}: {type_text(each)};"
        for field, each in schema["properties"].items()
    ]
    return "\n".join([doc, f"export interface {_identifier(name)} {{", *fields, "}"])


def _comment(text: str) -> str:
    return f"/** {' '.join(text.split()).replace('*/', '* /')} */"


def rest_text(document: dict[str, Any]) -> str:
    """Return the whole TypeScript file of an OpenAPI document."""
    schemas: dict[str, Any] = document["components"]["schemas"]
    routes: list[str] = []
    asked: set[str] = set()
    answered: set[str] = set()
    for path, method, operation in _operations(document):
        body, answer = _body(operation), _answer(operation)
        if body is None or answer is None:
            continue
        asked |= _named(body, schemas)
        answered |= _named(answer, schemas)
        parts = [
            f"readonly query: {_query_text(operation)}",
            f"readonly body: {type_text(body) if body else 'undefined'}",
            f"readonly answer: {type_text(answer) if answer else 'undefined'}",
        ]
        routes += [
            f"  {_comment(operation['description'].splitlines()[0])}",
            f'  readonly "{method.upper()} {path.removeprefix(_ROOT)}": {{ {"; ".join(parts)} }};',
        ]
    declarations = [
        # Of what the server itself sends no field is left out.
        declaration_text(name, schemas[name], whole=name not in asked)
        for name in sorted(asked | answered)
    ]
    doc = "/** What each route is asked with, and what it answers; paths are below `/api/v1`. */"
    table = "\n".join([doc, "export interface Routes {", *routes, "}"])
    return "\n\n".join([_HEADER.rstrip(), *declarations, table]) + "\n"


def _operations(document: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, operations in document["paths"].items():
        if path.startswith(f"{_ROOT}/"):
            for method, operation in operations.items():
                yield path, method, operation


def _body(operation: dict[str, Any]) -> dict[str, Any] | None:
    """Return the schema of the body, empty where none is sent, None where it is no JSON."""
    content = operation.get("requestBody", {}).get("content", {})
    return content.get(_JSON, {}).get("schema") if content else {}


def _answer(operation: dict[str, Any]) -> dict[str, Any] | None:
    """Return the schema of the answer, empty where it is, None where it is no JSON."""
    for status, answer in operation["responses"].items():
        if status.startswith("2"):
            content = answer.get("content", {})
            return content.get(_JSON, {}).get("schema") if content else {}
    return None


def _query_text(operation: dict[str, Any]) -> str:
    fields = [
        f"readonly {each['name']}{'' if each['required'] else '?'}: {type_text(each['schema'])}"
        for each in operation.get("parameters", [])
        if each["in"] == "query"
    ]
    return f"{{ {'; '.join(fields)} }}" if fields else "undefined"


def _named(schema: object, schemas: dict[str, Any]) -> set[str]:
    """Return the names of the schemas that ``schema`` refers to, over however many others."""
    found: set[str] = set()
    waiting = re.findall(f'"{_REFERENCE}([^"]+)"', json.dumps(schema))
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += re.findall(f'"{_REFERENCE}([^"]+)"', json.dumps(schemas[name]))
    return found


if __name__ == "__main__":
    sys.stdout.write(rest_text(openapi_document()))
