"""The webhook: one address that is told when a capture or a job has ended.

The body is ``{"type": "capture.succeeded", "timestamp": ..., "data": {...}}``, ``data`` being what
GET would return. With a secret every message is signed as Standard Webhooks say: the base64 of
HMAC-SHA256 over ``id.timestamp.body`` in ``webhook-signature``, behind ``v1,``. What is not taken
with a 2xx is sent again a few times, always with the same ``webhook-id``.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import json
import logging
import secrets
import time
from datetime import UTC, datetime

import httpx
from pydantic import BaseModel

from server.api.captures import view_from_record
from server.api.config import WebhookConfig
from server.api.jobs import view_from_job
from server.jobs.book import JobRecord
from server.mission.commands import MissionControl, UnknownError
from server.mission.events import CaptureChanged

logger = logging.getLogger(__name__)

_ENDS = frozenset({"succeeded", "failed", "aborted", "interrupted"})
_MOST_WAITING = 100


def signed_headers(secret: str, message_id: str, timestamp_s: int, body: bytes) -> dict[str, str]:
    """Return the headers of a message; without a secret it is not signed."""
    headers = {"webhook-id": message_id, "webhook-timestamp": str(timestamp_s)}
    if secret:
        signed = f"{message_id}.{timestamp_s}.".encode() + body
        mac = hmac.new(secret.encode(), signed, hashlib.sha256).digest()
        headers["webhook-signature"] = f"v1,{base64.b64encode(mac).decode()}"
    return headers


class Webhook:
    """Tells one address of ends, in order; what it does not take in time is dropped and logged."""

    def __init__(self, config: WebhookConfig, mission: MissionControl) -> None:
        self._config = config
        self._mission = mission
        self._waiting: asyncio.Queue[tuple[str, bytes]] = asyncio.Queue(_MOST_WAITING)
        self._told: str | None = None

    def job_ended(self, record: JobRecord) -> None:
        """Have the end of a job told."""
        self._tell(f"job.{record.state}", view_from_job(record))

    async def run(self) -> None:
        """Follow the captures and deliver, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._follow(), name="webhook captures")
            tasks.create_task(self._deliver_all(), name="webhook delivery")

    async def _follow(self) -> None:
        with self._mission.events.subscribe() as subscription:
            async for event in subscription:
                if not isinstance(event, CaptureChanged) or event.state not in _ENDS:
                    continue
                if event.id == self._told:
                    continue  # The end of a capture may be published more than once.
                self._told = event.id
                try:
                    record = self._mission.capture(event.id)
                except UnknownError:
                    continue  # Deleted meanwhile.
                view = view_from_record(record)
                # The mission may take the event down after us; its state is what ended.
                view = view.model_copy(update={"state": event.state, "error": event.error})
                self._tell(f"capture.{event.state}", view)

    def _tell(self, kind: str, view: BaseModel) -> None:
        at = datetime.now(UTC).isoformat()
        content = {"type": kind, "timestamp": at, "data": view.model_dump(mode="json")}
        try:
            self._waiting.put_nowait((f"msg_{secrets.token_hex(12)}", json.dumps(content).encode()))
        except asyncio.QueueFull:
            logger.error("the webhook takes nothing: %s is not told", kind)

    async def _deliver_all(self) -> None:
        async with httpx.AsyncClient(timeout=self._config.timeout_s) as client:
            while True:
                message_id, body = await self._waiting.get()
                if not await self._deliver(client, message_id, body):
                    logger.error("the webhook did not take message %s", message_id)

    async def _deliver(self, client: httpx.AsyncClient, message_id: str, body: bytes) -> bool:
        for attempt in range(self._config.attempts):
            if attempt:
                await asyncio.sleep(self._config.pause_s * 2 ** (attempt - 1))
            headers = signed_headers(self._config.secret, message_id, int(time.time()), body)
            headers["Content-Type"] = "application/json"
            try:
                answer = await client.post(self._config.url, content=body, headers=headers)
            except httpx.HTTPError as error:
                logger.warning("the webhook does not answer: %s", type(error).__name__)
                continue
            if answer.is_success:
                return True
            logger.warning("the webhook answers %d", answer.status_code)
        return False
