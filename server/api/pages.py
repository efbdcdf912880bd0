"""The few plain pages the server writes itself, and the headers that keep pages apart."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from html import escape

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 26rem; margin: 15vh auto; padding: 0 1rem; }
label, input, button { display: block; width: 100%; box-sizing: border-box; font: inherit; }
input, button { padding: .6rem; margin: .4rem 0 1rem; }
[role=alert] { border-left: .3rem solid #b3261e; padding-left: .7rem; }
"""
_STYLE_DIGEST = b64encode(hashlib.sha256(_STYLE.encode()).digest()).decode()

_PAGE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<main>
<h1>{title}</h1>
{body}
</main>
</body>
</html>
"""

# The dashboard: nothing from elsewhere; pictures also as data URLs and blobs (video tiles). Nothing
# inline but the one style sheet of the plain pages, by its digest.
_DASHBOARD_POLICY = (
    f"default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'sha256-{_STYLE_DIGEST}'; "
    "connect-src 'self'; frame-src 'self'; frame-ancestors 'self'; form-action 'self'; "
    "object-src 'none'; base-uri 'none'"
)
# The 3D viewer is one page with everything inlined; its decoders compile WebAssembly and scripts.
_SCENE_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' data: blob:; worker-src 'self' blob:; frame-ancestors 'self'; "
    "object-src 'none'; base-uri 'none'"
)


_NO_DEVICES = "camera=(), microphone=(), geolocation=(), payment=(), usb=()"


def login_page(message: str | None) -> str:
    """Return the page that asks for the token, with ``message`` above the field."""
    alert = f'<p role="alert">{escape(message)}</p>\n' if message else ""
    form = (
        '<form method="post" action="login">\n'
        '<label for="token">Token</label>\n'
        '<input id="token" name="token" type="password" autocomplete="current-password" '
        "required autofocus>\n"
        "<button>Sign in</button>\n"
        "</form>\n"
        "<p>The token was printed when the console was started.</p>"
    )
    return _PAGE.format(title="DroNeRF console", style=_STYLE, body=alert + form)


def unbuilt_page() -> str:
    """Return the page that stands in for a dashboard that was not built."""
    body = (
        "<p>The dashboard is not built. Run <code>make web</code> in the checkout and reload.</p>\n"
        "<p>The REST interface under <code>/api/v1</code> works without it.</p>"
    )
    return _PAGE.format(title="DroNeRF console", style=_STYLE, body=body)


class SecurityHeaders:
    """ASGI middleware that puts the security headers on every HTTP response."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on, and complete the headers of what comes back."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        policy = _SCENE_POLICY if scope["path"].startswith("/scene") else _DASHBOARD_POLICY

        async def complete(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault("Content-Security-Policy", policy)
                headers.setdefault("X-Content-Type-Options", "nosniff")
                # Not "no-referrer": with it browsers post forms from the origin "null".
                headers.setdefault("Referrer-Policy", "same-origin")
                headers.setdefault("Cross-Origin-Resource-Policy", "same-origin")
                headers.setdefault("Cross-Origin-Opener-Policy", "same-origin")
                headers.setdefault("X-Frame-Options", "SAMEORIGIN")
                headers.setdefault("Permissions-Policy", _NO_DEVICES)
                if scope["scheme"] == "https":
                    headers.setdefault("Strict-Transport-Security", "max-age=31536000")
                if scope["path"].startswith("/api/"):
                    headers.setdefault("Cache-Control", "no-store")
            await send(message)

        await self._app(scope, receive, complete)
