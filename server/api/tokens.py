"""Tokens: who holds which role, hand one out, take one back. For admins; and who one is oneself."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Request
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from server.api.access import Key, KeyRing, Role
from server.api.problems import described
from server.mission.commands import RefusedError, UnknownError

_TOKENS = "/api/v1/tokens"


class Visitor(BaseModel):
    """Whose token or session was shown, and what it allows."""

    id: str
    name: str
    role: Role


class TokenView(Visitor):
    """A token as it is listed; ``made_at`` of the console's own is empty."""

    made_at: str


class NewToken(TokenView):
    """A token just made: the only time that ``token`` itself is told."""

    token: str


class TokenSpec(BaseModel):
    """Whom to make a token for."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]*$")]
    role: Role


def visitor_of(request: Request) -> Key:
    """Return whose request this is, as the door has found out."""
    return request.state.visitor


def make_tokens_router(ring: KeyRing) -> APIRouter:
    """Return the routes ``/tokens`` and ``/me``."""
    router = APIRouter(prefix="/api/v1", tags=["access"])

    @router.get("/me", operation_id="getMe", responses=described())
    async def get_me(request: Request) -> Visitor:
        """Return whose token or session this request shows."""
        key = visitor_of(request)
        return Visitor(id=key.id, name=key.name, role=key.role)

    @router.get("/tokens", operation_id="listTokens", responses=described())
    async def list_tokens() -> list[TokenView]:
        """Return all tokens, the console's own first."""
        return [_view(key) for key in ring.all()]

    @router.post(
        "/tokens", operation_id="makeToken", status_code=201, responses=described(409, 422)
    )
    async def make_token(spec: TokenSpec, response: Response) -> NewToken:
        """Make a token; only its digest is kept, so write it down."""
        try:
            key, token = ring.add(spec.name, spec.role)
        except (ValueError, OSError) as error:
            raise RefusedError(str(error)) from error
        response.headers["Location"] = f"{_TOKENS}/{quote(key.id, safe='')}"
        return NewToken(**_view(key).model_dump(), token=token)

    @router.delete(
        "/tokens/{token_id}",
        operation_id="takeTokenBack",
        status_code=204,
        responses=described(404, 409),
    )
    async def take_token_back(token_id: str) -> Response:
        """Take a token back; the sessions that it opened end at once."""
        if token_id == ring.own.id:
            raise RefusedError("the console's own token is set when the console starts")
        try:
            known = ring.remove(token_id)
        except (ValueError, OSError) as error:
            raise RefusedError(str(error)) from error
        if not known:
            raise UnknownError(f"there is no token {token_id!r}")
        return Response(status_code=204)

    return router


def _view(key: Key) -> TokenView:
    return TokenView(id=key.id, name=key.name, role=key.role, made_at=key.made_at)
