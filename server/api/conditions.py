"""Files over HTTP: only where the client has not got them already (RFC 9110, 13), and whole."""

from __future__ import annotations

from email.utils import parsedate_to_datetime

from fastapi.responses import FileResponse, Response
from starlette.datastructures import Headers
from starlette.types import Message, Receive, Scope, Send

from server.api.problems import problem_response

_NO_RANGE = "The file has no such range of bytes."
# What a 304 repeats of the headers that the file would have come with.
_KEPT = frozenset({"etag", "last-modified", "cache-control", "content-disposition"})


def answer_if_wanted(asked: Headers, answer: Response) -> Response:
    """Return ``answer``, a 304 when the client has it already, or a 412 when it wants another."""
    etag, changed = answer.headers["etag"], answer.headers["last-modified"]
    if "if-match" in asked:
        if not _names(asked["if-match"], etag, weak=False):
            return problem_response(412, "The file is another one by now.")
    elif "if-unmodified-since" in asked and _is_later(changed, asked["if-unmodified-since"]):
        return problem_response(412, "The file is another one by now.")
    if "if-none-match" in asked:
        known = _names(asked["if-none-match"], etag, weak=True)
    else:
        since = asked.get("if-modified-since")
        known = since is not None and _is_later(changed, since) is False
    if not known:
        return answer
    unchanged = Response(status_code=304)
    for name, value in answer.headers.items():
        if name in _KEPT:
            unchanged.headers[name] = value
    return unchanged


def _names(field: str, etag: str, *, weak: bool) -> bool:
    """Return whether a list of entity tags holds ``etag``; weak ones count only where they may."""
    tags = [tag.strip() for tag in field.split(",")]
    if weak:
        tags = [tag.removeprefix("W/") for tag in tags]
    return "*" in tags or etag in tags


def _is_later(changed: str, asked: str) -> bool | None:
    """Return whether one HTTP date is later than another, None where one of them is none."""
    try:
        return parsedate_to_datetime(changed) > parsedate_to_datetime(asked)
    except (ValueError, TypeError):
        return None


class WholeFile(FileResponse):
    """A file response that keeps its word: no byte beyond the announced length.

    A file may grow while it is sent, as a log does; and a range that cannot be had is a problem
    document like all other errors.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the file, or what is wrong with the range asked for."""
        left = 0
        refused = False

        async def bounded(message: Message) -> None:
            nonlocal left, refused
            if message["type"] == "http.response.start":
                headers = Headers(raw=message["headers"])
                if message["status"] >= 400:
                    refused = True
                    kept = {k: v for k, v in headers.items() if k == "content-range"}
                    problem = problem_response(message["status"], _NO_RANGE, headers=kept)
                    await problem(scope, receive, send)
                    return
                left = int(headers["content-length"])
            elif refused:
                return
            elif message["type"] == "http.response.body":
                body = message.get("body", b"")[:left]
                left -= len(body)
                message = {**message, "body": body}
            await send(message)

        await super().__call__(scope, receive, bounded)
