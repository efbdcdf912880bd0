"""Who may come in: one token, shown as a bearer token or exchanged for a session cookie.

``Door`` decides and does no I/O; ``DoorKeeper`` is the ASGI middleware that asks it about every
request and websocket. Two paths are open to all, the health checks. A browser without a session
gets a small login page at ``/``; everything else is 401.

The cookie carries a random session id, never the token, and is HttpOnly and SameSite=Strict. As
cookies alone would let any page open a websocket here, websockets and unsafe methods must come from
our own origin, or from a program that names none.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from server.api.config import DoorConfig
from server.api.pages import login_page
from server.api.problems import problem_response

OPEN_PATHS = frozenset({"/livez", "/readyz"})
_SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
_DEFAULT_PORTS = {"http": ":80", "https": ":443", "ws": ":80", "wss": ":443"}
_LOGIN_BODY_LIMIT = 4096


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest()


class Door:
    """Knows the token and the sessions it was exchanged for.

    Attributes:
        cookie_name: Name of the session cookie. Browsers share cookies between the ports of a
            host, so the name differs from token to token and two consoles on one machine do not
            sign each other's browsers out.
    """

    def __init__(
        self,
        token: str,
        config: DoorConfig | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make a door that opens to ``token``.

        Raises:
            ValueError: If the token is empty or holds anything but visible ASCII characters.
        """
        if not token or not all("!" <= character <= "~" for character in token):
            raise ValueError("the token must be visible ASCII characters without spaces")
        self._token_digest = _digest(token)
        self._config = config or DoorConfig()
        self._clock = clock
        self._sessions: dict[bytes, float] = {}
        self.cookie_name = f"dronerf_session_{self._token_digest.hex()[:8]}"

    def is_token(self, text: str) -> bool:
        """Return whether ``text`` is the token, in constant time."""
        return hmac.compare_digest(_digest(text), self._token_digest)

    def open_session(self) -> str:
        """Return a new session id; the oldest session is forgotten when there are too many."""
        while len(self._sessions) >= self._config.sessions:
            del self._sessions[next(iter(self._sessions))]
        session_id = secrets.token_urlsafe(32)
        # Only digests are kept and looked up, so timing tells nothing about a valid id.
        self._sessions[_digest(session_id)] = self._clock() + self._config.session_s
        return session_id

    def is_session(self, session_id: str) -> bool:
        """Return whether ``session_id`` was handed out here and has not run out."""
        key = _digest(session_id)
        ends_s = self._sessions.get(key)
        if ends_s is None:
            return False
        if self._clock() >= ends_s:
            del self._sessions[key]
            return False
        return True

    def admits(self, headers: Headers) -> bool:
        """Return whether a request with ``headers`` shows the token or a session."""
        scheme, _, credentials = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self.is_token(credentials.strip()):
            return True
        session_id = _cookie(headers, self.cookie_name)
        return session_id is not None and self.is_session(session_id)

    def set_cookie(self, response: Response, secure: bool) -> None:
        """Open a session and put its cookie on ``response``."""
        response.set_cookie(
            self.cookie_name,
            self.open_session(),
            max_age=int(self._config.session_s),
            path="/",
            secure=secure,
            httponly=True,
            samesite="strict",
        )


def _cookie(headers: Headers, name: str) -> str | None:
    for line in headers.getlist("cookie"):
        try:
            cookies = SimpleCookie(line)
        except CookieError:
            continue
        if name in cookies:
            return cookies[name].value
    return None


def is_own_origin(headers: Headers) -> bool:
    """Return whether the request comes from our own pages, or from a program that is no browser.

    Browsers name the origin of every websocket and of every unsafe request. Only host and port
    are compared: behind a TLS proxy the scheme we see is not the one the browser sees.
    """
    origin = headers.get("origin")
    if origin is None:
        return True
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    if parts.scheme not in ("http", "https") or not parts.netloc:
        return False
    default = _DEFAULT_PORTS[parts.scheme]
    ours = headers.get("host", "").lower().removesuffix(default)
    return bool(ours) and parts.netloc.lower().removesuffix(default) == ours


class DoorKeeper:
    """ASGI middleware that lets in whom the door admits."""

    def __init__(self, app: ASGIApp, door: Door) -> None:
        self._app = app
        self._door = door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or hand on to the application."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        answer = await self._answer(scope, receive)
        await (answer or self._app)(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive) -> Response | None:
        """Return the door's own answer, or None when the request may pass."""
        is_http = scope["type"] == "http"
        method = scope["method"] if is_http else "WEBSOCKET"
        path = scope["path"]
        if is_http and path in OPEN_PATHS:
            return None
        headers = Headers(scope=scope)
        if method not in _SAFE_METHODS and not is_own_origin(headers):
            return problem_response(403, "Requests from other origins are refused.", code="origin")
        if method == "GET" and path == "/":
            fields = parse_qs(scope["query_string"].decode("latin-1"))
            if "token" in fields:
                return self._exchange(fields["token"][-1], scope)
        if method == "POST" and path == "/login":
            body = await _body(receive)
            return self._exchange(_form_token(body), scope)
        if self._door.admits(headers):
            return None
        if method == "GET" and path == "/":
            return _login(None)
        return problem_response(
            401,
            "Show the token: Authorization: Bearer, or sign in at /.",
            code="unauthorized",
            headers={"WWW-Authenticate": 'Bearer realm="dronerf"'},
        )

    def _exchange(self, token: str, scope: Scope) -> Response:
        if not self._door.is_token(token):
            return _login("That is not the token.")
        # 303 turns the form's POST into a GET and takes the token out of the address bar.
        response = RedirectResponse("/", status_code=303, headers={"Cache-Control": "no-store"})
        self._door.set_cookie(response, secure=scope.get("scheme") == "https")
        return response


def _login(message: str | None) -> Response:
    headers = {"Cache-Control": "no-store", "WWW-Authenticate": 'Bearer realm="dronerf"'}
    return HTMLResponse(login_page(message), status_code=401, headers=headers)


def _form_token(body: bytes) -> str:
    fields = parse_qs(body.decode("latin-1"))
    return fields.get("token", [""])[-1].strip()


async def _body(receive: Receive) -> bytes:
    """Return the request's body; what is longer than any login form is cut off."""
    body = b""
    while True:
        message = await receive()
        if message["type"] != "http.request":
            return b""
        body += message.get("body", b"")
        if not message.get("more_body", False) or len(body) > _LOGIN_BODY_LIMIT:
            return body[:_LOGIN_BODY_LIMIT]
