"""Who may come in: a token, shown as a bearer token or exchanged for a session cookie.

``Door`` decides and does no I/O; ``DoorKeeper`` is the ASGI middleware that asks it about every
request and websocket. Two paths are open to all, the health checks. A browser without a session
gets a small login page at ``/``; everything else is 401, and 403 where the token's role is not
enough.

The cookie carries a random session id, never the token, and is HttpOnly and SameSite=Strict. As
cookies alone would let any page open a websocket here, websockets and unsafe methods must come from
our own origin, or from a program that names none. A session ends with the token it was opened by.

Sign-ins are counted per address, and too many wrong ones have to wait. Bearer tokens are not: a
program that shows a wrong one must not keep others at the same address from their drones.
"""

from __future__ import annotations

import asyncio
import math
import re
import time
from collections.abc import Callable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from server.api.access import Key, KeyRing, Role, allows
from server.api.attempts import Attempts
from server.api.config import DoorConfig
from server.api.pages import login_page
from server.api.problems import problem_response
from server.api.sessions import Sessions

OPEN_PATHS = frozenset({"/livez", "/readyz"})
# What is taken back here can be set again: no file is lost with it.
_TAKEN_BACK = re.compile(r"/api/v1/captures/[^/]+/(view|star)")
_SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
_DEFAULT_PORTS = {"http": ":80", "https": ":443", "ws": ":80", "wss": ":443"}
_LOGIN_BODY_LIMIT = 4096


def needed_role(method: str, path: str) -> Role:
    """Return the least role that may make such a request; websockets say what may be said there."""
    if path == "/api/v1/tokens" or path.startswith("/api/v1/tokens/"):
        return "admin"
    if method in _SAFE_METHODS or method == "WEBSOCKET":
        return "viewer"
    deletes = method == "DELETE" and path.startswith("/api/v1/captures/")
    return "admin" if deletes and _TAKEN_BACK.fullmatch(path) is None else "operator"


class TooManyAttemptsError(Exception):
    """Too many wrong tokens came from an address; it may try again after ``wait_s`` seconds."""

    def __init__(self, wait_s: float) -> None:
        super().__init__(f"wait {wait_s:.0f} seconds")
        self.wait_s = wait_s


class Door:
    """Knows the tokens and the sessions they were exchanged for.

    Attributes:
        attempts: Counts wrong tokens at the sign-in.
        sessions: The browsers that are signed in.
        cookie_name: Name of the session cookie. Browsers share cookies between the ports of a
            host, so the name differs from token to token and two consoles on one machine do not
            sign each other's browsers out.
        prefix: Path that a proxy puts before all of ours, empty without one.
    """

    def __init__(
        self,
        ring: KeyRing,
        config: DoorConfig | None = None,
        clock: Callable[[], float] = time.monotonic,
        prefix: str = "",
        sessions: Sessions | None = None,
    ) -> None:
        """Make a door that opens to the tokens of ``ring``, and to ``sessions`` from before."""
        self.ring = ring
        self.prefix = prefix
        self._config = config or DoorConfig()
        self._clock = clock
        self.sessions = sessions or Sessions(self._config.sessions, self._config.session_s)
        self.attempts = Attempts(self._config.attempts, self._config.attempts_s)
        self.cookie_name = f"dronerf_session_{ring.own.digest[:8]}"

    def sign_in(self, token: str, address: str) -> Key | None:
        """Return the key of ``token``, None when it is wrong.

        Raises:
            TooManyAttemptsError: If ``address`` has to wait before it may try again.
        """
        wait_s = self.attempts.wait_s(address, self._clock())
        if wait_s > 0.0:
            raise TooManyAttemptsError(wait_s)
        key = self.ring.find(token)
        if key is None:
            self.attempts.note(address, self._clock())
        return key

    def end_session(self, headers: Headers) -> None:
        """Forget the session that a request shows, if any."""
        self.sessions.end(_cookie(headers, self.cookie_name) or "")

    def visitor(self, headers: Headers) -> Key | None:
        """Return whose token or session a request with ``headers`` shows, None without any."""
        scheme, _, credentials = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            found = self.ring.find(credentials.strip())
            if found is not None:
                return found
        session_id = _cookie(headers, self.cookie_name)
        return None if session_id is None else self.sessions.key(session_id, self.ring)

    def set_cookie(self, response: Response, key: Key, secure: bool) -> None:
        """Open a session and put its cookie on ``response``."""
        response.set_cookie(
            self.cookie_name,
            self.sessions.open(key),
            max_age=int(self._config.session_s),
            path=f"{self.prefix}/",
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
                return await self._exchange(fields["token"][-1], scope)
        if method == "POST" and path == "/login":
            body = await _body(receive)
            return await self._exchange(_form_token(body), scope)
        if method == "POST" and path == "/logout":
            self._door.end_session(headers)
            await asyncio.to_thread(self._door.sessions.save)
            return RedirectResponse("/", status_code=303, headers={"Cache-Control": "no-store"})
        visitor = self._door.visitor(headers)
        if visitor is not None:
            # Routes ask for it where what they do depends on who asks.
            scope.setdefault("state", {})["visitor"] = visitor
            return _forbidden(visitor, method, path)
        if method == "GET" and path == "/":
            return _login(None)
        return problem_response(
            401,
            "Show the token: Authorization: Bearer, or sign in at /.",
            headers={"WWW-Authenticate": 'Bearer realm="dronerf"'},
        )

    async def _exchange(self, token: str, scope: Scope) -> Response:
        client = scope.get("client")
        try:
            found = self._door.sign_in(token, client[0] if client else "")
        except TooManyAttemptsError as error:
            return _wait(error.wait_s)
        if found is None:
            return _login("That is not the token.")
        # 303 turns the form's POST into a GET and takes the token out of the address bar.
        response = RedirectResponse("/", status_code=303, headers={"Cache-Control": "no-store"})
        self._door.set_cookie(response, found, secure=scope.get("scheme") == "https")
        await asyncio.to_thread(self._door.sessions.save)
        return response


def _forbidden(visitor: Key, method: str, path: str) -> Response | None:
    needed = needed_role(method, path)
    if allows(visitor.role, needed):
        return None
    detail = f"This is for {needed}s; the token shown is a {visitor.role}'s."
    return problem_response(403, detail)


def _wait(wait_s: float) -> Response:
    headers = {"Cache-Control": "no-store", "Retry-After": str(math.ceil(wait_s))}
    text = f"Too many wrong tokens from your address; wait {math.ceil(wait_s)} seconds."
    return HTMLResponse(login_page(text), status_code=429, headers=headers)


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
