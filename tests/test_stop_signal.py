"""Ending the console: every way to ask for it lands first, a second one does not wait."""

from __future__ import annotations

import asyncio
import os
import signal

import pytest

from server.app import stop_signal

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.mark.parametrize("number", SIGNALS)
def test_each_signal_to_end_asks_once_to_land(number: signal.Signals) -> None:
    async def story() -> None:
        stop = stop_signal()
        try:
            os.kill(os.getpid(), number)
            async with asyncio.timeout(5.0):
                await stop.wait()
        finally:
            for each in SIGNALS:
                asyncio.get_running_loop().remove_signal_handler(each)

    # Tests that run in the background find these signals ignored, and the program leaves that.
    before = {each: signal.signal(each, signal.SIG_DFL) for each in SIGNALS}
    try:
        asyncio.run(story())
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def test_a_console_that_shall_outlive_its_terminal_does() -> None:
    async def story() -> None:
        stop = stop_signal()
        try:
            os.kill(os.getpid(), signal.SIGHUP)
            await asyncio.sleep(0.1)
            assert not stop.is_set()
        finally:
            for each in (signal.SIGINT, signal.SIGTERM):
                asyncio.get_running_loop().remove_signal_handler(each)

    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        asyncio.run(story())
    finally:
        signal.signal(signal.SIGHUP, before)
