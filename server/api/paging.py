"""Pages of a list: a bounded number of items, and where the next ones begin.

The body stays a plain JSON list; the next page is in the header ``Link`` (RFC 8288). A cursor names
the last item shown, not a count, so that what comes or goes meanwhile is neither shown twice nor
makes others be left out. Any text is a cursor: the list goes on after where it would stand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated, Any, TypeVar
from urllib.parse import urlencode

from fastapi import Query
from fastapi.responses import Response

Item = TypeVar("Item")
_MOST = 1000

Limit = Annotated[int, Query(ge=1, le=_MOST, description="The most items to return.")]
Cursor = Annotated[
    str | None,
    Query(max_length=1000, description="Where to go on: that of the header Link, rel=next."),
]

# What an OpenAPI description says about a paged answer.
PAGED: dict[str, Any] = {
    "headers": {
        "Link": {
            "description": "Where the next page is (RFC 8288, rel=next); absent on the last one.",
            "schema": {"type": "string"},
        }
    }
}


def page_of(
    items: Iterable[Item], name: Callable[[Item], str], limit: int, cursor: str | None
) -> tuple[list[Item], str | None]:
    """Return a page of ``items`` and the next page's cursor, None on the last page.

    Args:
        items: All items, by falling ``name``.
        name: An item's name, by which they are sorted.
        limit: Most items on a page.
        cursor: The last item's name on the page before, None for the first page.
    """
    page: list[Item] = []
    for item in items:
        if cursor is not None and name(item) >= cursor:
            continue
        if len(page) == limit:
            return page, name(page[-1])
        page.append(item)
    return page, None


def link_next(response: Response, path: str, cursor: str | None, **query: Any) -> None:
    """Say in ``response`` where the next page of ``path`` is, if there is one."""
    if cursor is not None:
        asked = {key: value for key, value in query.items() if value is not None}
        response.headers["Link"] = f'<{path}?{urlencode(asked | {"cursor": cursor})}>; rel="next"'
